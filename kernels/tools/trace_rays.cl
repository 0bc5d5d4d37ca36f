/* Rays in plain arrays, for benchmarks and tests.

   A ray: origins (xyz, time in the groom's steps), directions (xyz, t_max), from_segment (segment or triangle).
   Both kernels are launched over rays, FURCL_RAYS_PER_ITEM a work-item. */
#include "bvh/traversal.clh"

typedef struct {
    __global const float4* origins;
    __global const float4* directions;
    __global const uint* from_segment;
    __global float* t;
    __global uint* segment;
    __global float* u;
    __global const StoredVertex* vertices;  /* of the groom */
} ArrayRays;

static inline void load_array_ray(const ArrayRays* rays, uint i, Query* query, Hit* hit)
{
    const float4 o = rays->origins[i], d = rays->directions[i];
    *query = (Query){o.xyz, d.xyz, rays->from_segment[i]};
#if FURCL_MESHES
    query->reach = reach_of(rays->vertices, query->from_segment);
#endif
#if FURCL_MOTION
    query->time = o.w;
#endif
    *hit = (Hit){d.w, 0.0f, FURCL_NO_SEGMENT};
}

static inline void store_array_hit(const ArrayRays* rays, uint i, const Hit* hit)
{
    rays->t[i] = hit->t;
    rays->segment[i] = hit->segment;
    rays->u[i] = hit->u;
}

static inline void store_array_occluded(const ArrayRays* rays, uint i, const Hit* hit)
{
    rays->segment[i] = hit->segment != FURCL_NO_SEGMENT ? 1u : 0u;
}

/* reads    rays
   writes   nearest hits in (0, t_max]: t, segment, u; of a miss t_max, FURCL_NO_SEGMENT, 0 */
__kernel void trace_rays(
    const uint n_rays, __global const float4* origins, __global const float4* directions,
    __global const uint* from_segment, __global float* t, __global uint* segment, __global float* u,
    __global const uint* blocks, __global const StoredVertex* vertices, __global const uint* strands
#if FURCL_MESHES
    , __global const float4* corners
#endif
    )
{
    const Groom groom = groom_of(blocks, vertices, strands
#if FURCL_MESHES
        , corners
#endif
        );
    const ArrayRays rays = {origins, directions, from_segment, t, segment, u, vertices};
    TRACE_RAYS(&groom, n_rays, false, load_array_ray, store_array_hit, &rays);
}

/* reads    rays
   writes   occluded: 1 where anything lies in (0, t_max], else 0 */
__kernel void trace_shadow_rays(
    const uint n_rays, __global const float4* origins, __global const float4* directions,
    __global const uint* from_segment, __global float* t, __global uint* occluded,
    __global const uint* blocks, __global const StoredVertex* vertices, __global const uint* strands
#if FURCL_MESHES
    , __global const float4* corners
#endif
    )
{
    const Groom groom = groom_of(blocks, vertices, strands
#if FURCL_MESHES
        , corners
#endif
        );
    const ArrayRays rays = {origins, directions, from_segment, t, occluded, 0, vertices};
    TRACE_RAYS(&groom, n_rays, true, load_array_ray, store_array_occluded, &rays);
}
