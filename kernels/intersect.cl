/* Rays against the groom.

   Work-items take rays one each; on CPUs the vectors are inside a ray (eight boxes or segments). */
#include "bvh.clh"

#define VECTOR_HINT __attribute__((vec_type_hint(float8)))

/* Rays in plain arrays, for benchmarks and tests.
   reads     origins (xyz, distance skipped on the own strand), directions (xyz, t_max), skip_segment
   writes    t, segment, u of the nearest hit in (0, t_max]; a miss: t_max, FURCL_NO_SEGMENT, 0
   launched  over rays */
__kernel VECTOR_HINT void trace_rays(BVH_PARAMETERS, uint n_rays, __global const float4* origins,
                                     __global const float4* directions,
                                     __global const uint* skip_segment, __global float* t,
                                     __global uint* segment, __global float* u)
{
    const uint i = get_global_id(0);
    if (i >= n_rays) return;
    const float4 o = origins[i], d = directions[i];
    const Ray ray = {o.xyz, d.xyz, d.w, o.w, skip_segment[i]};
    Hit hit = {d.w, 0.0f, FURCL_NO_SEGMENT};
    bvh_query(BVH_ARGUMENTS, &ray, &hit, false);
    t[i] = hit.t;
    segment[i] = hit.segment;
    u[i] = hit.u;
}

/* The same, asking only whether anything lies in (0, t_max].
   writes    occluded: 1 or 0 */
__kernel VECTOR_HINT void trace_shadow_rays(BVH_PARAMETERS, uint n_rays,
                                            __global const float4* origins,
                                            __global const float4* directions,
                                            __global const uint* skip_segment,
                                            __global uint* occluded)
{
    const uint i = get_global_id(0);
    if (i >= n_rays) return;
    const float4 o = origins[i], d = directions[i];
    const Ray ray = {o.xyz, d.xyz, d.w, o.w, skip_segment[i]};
    Hit hit = {d.w, 0.0f, FURCL_NO_SEGMENT};
    occluded[i] = bvh_query(BVH_ARGUMENTS, &ray, &hit, true) ? 1u : 0u;
}
