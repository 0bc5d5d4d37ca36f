/* Stage 2 of 5. Rays against the groom and the body.

   One work-item a ray; on CPUs the vectors are inside a ray (eight boxes or segments at a time). */
#include "body.clh"
#include "bvh.clh"
#include "spectrum.clh"

#define VECTOR_HINT __attribute__((vec_type_hint(float8)))

/* Finds what the ray of every path meets first.

   reads    state: ORIGIN, DIR, SKIP_*; the tree; active_counts: COUNT_NEXT of the bounce before
   writes   state: HIT_*; hit queue, miss queue and their lengths in counts
   over     the queue of paths that go on
   next     shade_escaped over the miss queue, sample_lobe_h over the hit queue */
__kernel VECTOR_HINT void intersect_closest(
    __global float* state, __global const uint* queue, __global uint* hit_queue,
    __global uint* miss_queue, __global const uint* active_counts, __global uint* counts,
    const uint n_slots, const Body body, BVH_PARAMETERS)
{
    const uint i = get_global_id(0);
    if (i >= active_counts[FURCL_COUNT_NEXT]) return;
    const uint slot = queue[i];
    const Query query = {PS_LOAD3(ORIGIN, slot), PS_LOAD3(DIR, slot), INFINITY,
                         PS_F(SKIP_DISTANCE, slot), PS_U(SKIP_SEGMENT, slot)};
    Hit hit = {INFINITY, 0.0f, FURCL_NO_SEGMENT};
#if FURCL_BODY
    body_query(&body, &query, &hit);
#endif
    bvh_query(BVH_ARGUMENTS, &query, &hit, false);
    PS_U(HIT_SEGMENT, slot) = hit.segment;
    if (hit.segment == FURCL_NO_SEGMENT) {
        miss_queue[atomic_inc(counts + FURCL_COUNT_MISSES)] = slot;
    } else {
        PS_F(HIT_T, slot) = hit.t;
        PS_F(HIT_U, slot) = hit.u;
        hit_queue[atomic_inc(counts + FURCL_COUNT_HITS)] = slot;
    }
}

#if FURCL_LIGHT_SAMPLING
/* Adds the light sample of every path that nothing keeps from it.

   reads    state: ORIGIN, SHADOW_*, SKIP_SEGMENT; the tree
   writes   state: RADIANCE
   over     the shadow queue
   next     intersect_closest */
__kernel VECTOR_HINT void intersect_shadow(
    __global float* state, __global const uint* shadow_queue, __global const uint* counts,
    const uint n_slots, const Body body, BVH_PARAMETERS)
{
    const uint i = get_global_id(0);
    if (i >= counts[FURCL_COUNT_SHADOWS]) return;
    const uint slot = shadow_queue[i];
    const Query query = {PS_LOAD3(ORIGIN, slot), PS_LOAD3(SHADOW_DIR, slot), INFINITY,
                         PS_F(SHADOW_SKIP_DISTANCE, slot), PS_U(SKIP_SEGMENT, slot)};
    Hit hit = {INFINITY, 0.0f, FURCL_NO_SEGMENT};
#if FURCL_BODY
    if (body_query(&body, &query, &hit)) return;
#endif
    if (bvh_query(BVH_ARGUMENTS, &query, &hit, true)) return;
    PS_STORE_SPECTRUM(RADIANCE, slot,
        PS_LOAD_SPECTRUM(RADIANCE, slot) + PS_LOAD_SPECTRUM(SHADOW_RADIANCE, slot));
}
#endif

/* Rays in plain arrays, for benchmarks and tests.

   reads    origins (xyz, distance skipped on the own strand), directions (xyz, t_max), skip_segment
   writes   nearest hits in (0, t_max]: t, segment, u; of a miss t_max, FURCL_NO_SEGMENT, 0
   over     rays */
__kernel VECTOR_HINT void trace_rays(
    const uint n_rays, __global const float4* origins, __global const float4* directions,
    __global const uint* skip_segment, __global float* t, __global uint* segment,
    __global float* u, BVH_PARAMETERS)
{
    const uint i = get_global_id(0);
    if (i >= n_rays) return;
    const float4 o = origins[i], d = directions[i];
    const Query query = {o.xyz, d.xyz, d.w, o.w, skip_segment[i]};
    Hit hit = {d.w, 0.0f, FURCL_NO_SEGMENT};
    bvh_query(BVH_ARGUMENTS, &query, &hit, false);
    t[i] = hit.t;
    segment[i] = hit.segment;
    u[i] = hit.u;
}

/* The same rays, asking only whether anything lies in (0, t_max].

   reads    as trace_rays
   writes   occluded: 1 or 0
   over     rays */
__kernel VECTOR_HINT void trace_shadow_rays(
    const uint n_rays, __global const float4* origins, __global const float4* directions,
    __global const uint* skip_segment, __global uint* occluded, BVH_PARAMETERS)
{
    const uint i = get_global_id(0);
    if (i >= n_rays) return;
    const float4 o = origins[i], d = directions[i];
    const Query query = {o.xyz, d.xyz, d.w, o.w, skip_segment[i]};
    Hit hit = {d.w, 0.0f, FURCL_NO_SEGMENT};
    occluded[i] = bvh_query(BVH_ARGUMENTS, &query, &hit, true) ? 1u : 0u;
}
