/* Rays in plain arrays, for benchmarks and tests.

   A ray: origins (xyz, time in the groom's steps), directions (xyz, t_max), from_segment (segment or triangle).
   Both kernels are launched over rays, FURCL_RAYS_PER_ITEM a work-item. With FURCL_MESHES there are
   triangles beside the groom, as in stages/intersect.cl: they come first, and the search for fibres begins
   with what it found. */
#include "bvh/traversal.clh"
#if FURCL_MESHES
#include "bvh/triangles.clh"
#endif

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
#if FURCL_MOTION
    query->time = o.w;
#endif
    *hit = (Hit){d.w, 0.0f, FURCL_NO_SEGMENT};
#if FURCL_MESHES
    if (query->from_segment >= FURCL_TRIANGLE) query->from_segment = FURCL_NO_SEGMENT;
    hit->t = rays->t[i];
    hit->segment = rays->segment[i];
#endif
}

static inline void store_array_hit(const ArrayRays* rays, uint i, const Hit* hit)
{
    rays->t[i] = hit->t;
    rays->segment[i] = hit->segment;
    rays->u[i] = hit->u;
}

#if FURCL_MESHES

static inline void load_array_mesh_ray(const ArrayRays* rays, uint i, Query* query, Hit* hit)
{
    const float4 o = rays->origins[i], d = rays->directions[i];
    const uint from = rays->from_segment[i];
    *query = (Query){o.xyz, d.xyz, from, from < FURCL_TRIANGLE ? reach_of(rays->vertices, from) : 0.0f};
    *hit = (Hit){d.w, 0.0f, FURCL_NO_SEGMENT};
}

static inline void store_array_mesh_hit(const ArrayRays* rays, uint i, const Hit* hit)
{
    rays->t[i] = hit->t;
    rays->segment[i] = hit->segment;
}

/* A triangle in the way ends the search for fibres where it begins. */
static inline void load_array_shadow_ray(const ArrayRays* rays, uint i, Query* query, Hit* hit)
{
    load_array_ray(rays, i, query, hit);
    if (hit->segment != FURCL_NO_SEGMENT) hit->t = 0.0f;
}

#else
#define load_array_shadow_ray load_array_ray
#endif

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
    , __global const uint* mesh_blocks, __global const StoredVertex* mesh_vertices,
    __global const uint* mesh_ends
#endif
    )
{
    const Groom groom = groom_of(blocks, vertices, strands);
    const ArrayRays rays = {origins, directions, from_segment, t, segment, u, vertices};
#if FURCL_MESHES
    const Groom meshes = groom_of(mesh_blocks, mesh_vertices, mesh_ends);
    TRACE_RAYS(triangles, &meshes, n_rays, false, load_array_mesh_ray, store_array_mesh_hit, &rays);
#endif
    TRACE_RAYS(segments, &groom, n_rays, false, load_array_ray, store_array_hit, &rays);
}

/* reads    rays
   writes   occluded: 1 where anything lies in (0, t_max], else 0; t */
__kernel void trace_shadow_rays(
    const uint n_rays, __global const float4* origins, __global const float4* directions,
    __global const uint* from_segment, __global float* t, __global uint* occluded,
    __global const uint* blocks, __global const StoredVertex* vertices, __global const uint* strands
#if FURCL_MESHES
    , __global const uint* mesh_blocks, __global const StoredVertex* mesh_vertices,
    __global const uint* mesh_ends
#endif
    )
{
    const Groom groom = groom_of(blocks, vertices, strands);
    const ArrayRays rays = {origins, directions, from_segment, t, occluded, 0, vertices};
#if FURCL_MESHES
    const Groom meshes = groom_of(mesh_blocks, mesh_vertices, mesh_ends);
    TRACE_RAYS(triangles, &meshes, n_rays, true, load_array_mesh_ray, store_array_mesh_hit, &rays);
#endif
    TRACE_RAYS(segments, &groom, n_rays, true, load_array_shadow_ray, store_array_occluded, &rays);
}
