/* Stage 2. Rays against meshes, the surface, the lamps and the groom.

   A work-item takes FURCL_RAYS_PER_ITEM rays; the vectors are inside a ray (eight lanes at a time). */
#include "bvh/traversal.clh"
#include "core/paths.clh"
#if FURCL_SURFACE
#include <surface>
#endif
#if FURCL_AREA_LAMPS
#include <lamps>
#endif

/* What the rays of a kernel are read from and what becomes of them. */
typedef struct {
    Paths paths;
    __global const uint* queue;
    __global uint* hit_queues;  /* of n_slots each: of each fibre material, then the surface's */
    __global uint* miss_queue;
    __global uint* counts;
#if FURCL_FIBRES > 1
    __global const uint* material_starts;
#endif
#if FURCL_SURFACE
    const SurfaceParams* surface;
#endif
#if FURCL_MESHES
    __global const StoredVertex* vertices;  /* of the groom */
#endif
#if FURCL_AREA_LAMPS
    __global const float* light;
#endif
#if FURCL_LAYER_LOBES
    uint depth;
#endif
} PathRays;

#if FURCL_FIBRES > 1
/* The material of the fibre that a vertex belongs to. Strands are in the order of their materials;
   `starts` are the first vertices of all materials but the first. */
static inline uint material_of_vertex(__global const uint* starts, uint vertex)
{
    uint material = 0u;
    for (uint i = 0; i < FURCL_FIBRES - 1u; i++) material += vertex >= starts[i] ? 1u : 0u;
    return material;
}
#endif

#if FURCL_LIGHT_SAMPLING
/* How far a light sample is away. */
static inline float shadow_distance(Paths paths, uint slot)
{
#if FURCL_SHADOW_DISTANCES
    return path_float(paths, PS_SHADOW_DISTANCE, slot);
#else
    return INFINITY;
#endif
}
#endif

/* The search along the ray of a path in the direction that is in a plane of its state. */
static inline Query path_query(const PathRays* rays, uint slot, uint direction_plane)
{
    const Paths paths = rays->paths;
    Query query = {path_float3(paths, PS_ORIGIN, slot), path_float3(paths, direction_plane, slot),
                   path_uint(paths, PS_FROM_SEGMENT, slot)};
#if FURCL_MESHES
    query.reach = reach_of(rays->vertices, query.from_segment);
#endif
#if FURCL_MOTION
    query.time = path_time(paths, slot);
#endif
    return query;
}

static inline void load_path_ray(const PathRays* rays, uint i, Query* query, Hit* hit)
{
    *query = path_query(rays, queued_slot(rays->paths, rays->queue, i), PS_DIR);
    *hit = (Hit){INFINITY, 0.0f, FURCL_NO_SEGMENT};
#if FURCL_SURFACE
    surface_hit(rays->surface, query, hit);
#endif
#if FURCL_AREA_LAMPS
    lamps_hit(rays->light, query, FURCL_NO_LAMP, hit);
#endif
}

static inline void store_path_hit(const PathRays* rays, uint i, const Hit* hit)
{
    const Paths paths = rays->paths;
    const uint slot = queued_slot(paths, rays->queue, i);
    bool ends = hit->segment == FURCL_NO_SEGMENT;
#if FURCL_AREA_LAMPS
    ends |= hit->segment == FURCL_LAMP_HIT;
#endif
    if (ends) {
#if FURCL_AREA_LAMPS
        set_path_uint(paths, PS_HIT_SEGMENT, slot, hit->segment);
        set_path_float(paths, PS_HIT_U, slot, hit->u);
        set_path_float(paths, PS_HIT_T, slot, hit->t);
#endif
        const uint place = atomic_inc(rays->counts + FURCL_COUNT_MISSES);
        rays->miss_queue[FURCL_SLOT(paths, place)] = slot;
        return;
    }
    uint material = 0u;
#if FURCL_FIBRES > 1
    material = material_of_vertex(rays->material_starts, hit->segment);
#endif
#if FURCL_SURFACE || FURCL_MESHES
    set_path_float(paths, PS_HIT_T, slot, hit->t);
    if (hit->segment >= FURCL_TRIANGLE) material = FURCL_FIBRES;
#endif
    set_path_float(paths, PS_HIT_U, slot, hit->u);
    set_path_uint(paths, PS_HIT_SEGMENT, slot, hit->segment);
    const uint place = atomic_inc(rays->counts + FURCL_COUNT_HITS + material);
    rays->hit_queues[(size_t)material * paths.n_slots + FURCL_SLOT(paths, place)] = slot;
}

/* Finds what the ray of every path meets first.

   reads    state: ORIGIN, DIR, FROM_SEGMENT; the groom, meshes; active_counts: COUNT_NEXT of the bounce
            before
   writes   state: HIT_*; the hit queue of each material, the miss queue, where lamps are too, and their
            lengths in counts
   over     the queue of paths that go on, FURCL_RAYS_PER_ITEM a work-item
   next     shade_escaped over the miss queue; for each material sample_lobe_h and shade, or
            shade_surface, over its hit queue */
__kernel void intersect_closest(
    __global float* state, __global const uint* queue, __global uint* hit_queues,
    __global uint* miss_queue, __global const uint* active_counts, __global uint* counts,
    const uint n_slots, __global const uint* blocks, __global const StoredVertex* vertices,
    __global const uint* strands
#if FURCL_FIBRES > 1
    , __global const uint* material_starts
#endif
#if FURCL_MESHES
    , __global const float4* corners
#endif
#if FURCL_SURFACE
    , const SurfaceParams surface
#endif
#if FURCL_AREA_LAMPS
    , __global const float* light
#endif
    )
{
    const Groom groom = groom_of(blocks, vertices, strands
#if FURCL_MESHES
        , corners
#endif
        );
    PathRays rays;
    rays.paths = (Paths){state, n_slots};
    rays.queue = queue;
    rays.hit_queues = hit_queues;
    rays.miss_queue = miss_queue;
    rays.counts = counts;
#if FURCL_FIBRES > 1
    rays.material_starts = material_starts;
#endif
#if FURCL_SURFACE
    rays.surface = &surface;
#endif
#if FURCL_AREA_LAMPS
    rays.light = light;
#endif
#if FURCL_MESHES
    rays.vertices = vertices;
#endif
    TRACE_RAYS(&groom, active_counts[FURCL_COUNT_NEXT], false, load_path_ray, store_path_hit, &rays);
}

#if FURCL_LIGHT_SAMPLING

/* A surface or a lamp in the way ends the search where it begins. */
static inline void load_shadow_ray(const PathRays* rays, uint i, Query* query, Hit* hit)
{
    const Paths paths = rays->paths;
    const uint slot = queued_slot(paths, rays->queue, i);
    *query = path_query(rays, slot, PS_SHADOW_DIR);
    *hit = (Hit){shadow_distance(paths, slot), 0.0f, FURCL_NO_SEGMENT};
#if FURCL_SURFACE
    if (surface_hit(rays->surface, query, hit)) hit->t = 0.0f;
#endif
#if FURCL_AREA_LAMPS
    if (lamps_hit(rays->light, query, path_uint(paths, PS_SHADOW_LAMP, slot), hit)) hit->t = 0.0f;
#endif
}

static inline void store_shadow_hit(const PathRays* rays, uint i, const Hit* hit)
{
    const Paths paths = rays->paths;
    if (hit->segment != FURCL_NO_SEGMENT) return;
    const uint slot = queued_slot(paths, rays->queue, i);
#if FURCL_LAYER_LOBES
    if (rays->depth == 0u) set_path_uint(paths, PS_FIRST_SEEN, slot, 1u);
#endif
    set_path_spectrum(paths, PS_RADIANCE, slot,
                      path_spectrum(paths, PS_RADIANCE, slot) +
                          path_spectrum(paths, PS_SHADOW_RADIANCE, slot));
}

/* Adds the light sample of every path that nothing keeps from it.

   reads    state: ORIGIN, SHADOW_*, FROM_SEGMENT; the groom, meshes
   writes   state: RADIANCE
   over     the shadow queue, FURCL_RAYS_PER_ITEM a work-item
   next     intersect_closest */
__kernel void intersect_shadow(
    __global float* state, __global const uint* shadow_queue, __global const uint* counts,
    const uint n_slots, __global const uint* blocks, __global const StoredVertex* vertices,
    __global const uint* strands
#if FURCL_MESHES
    , __global const float4* corners
#endif
#if FURCL_SURFACE
    , const SurfaceParams surface
#endif
#if FURCL_AREA_LAMPS
    , __global const float* light
#endif
#if FURCL_LAYER_LOBES
    , const uint depth
#endif
    )
{
    const Groom groom = groom_of(blocks, vertices, strands
#if FURCL_MESHES
        , corners
#endif
        );
    PathRays rays;
    rays.paths = (Paths){state, n_slots};
    rays.queue = shadow_queue;
#if FURCL_LAYER_LOBES
    rays.depth = depth;
#endif
#if FURCL_SURFACE
    rays.surface = &surface;
#endif
#if FURCL_AREA_LAMPS
    rays.light = light;
#endif
#if FURCL_MESHES
    rays.vertices = vertices;
#endif
    TRACE_RAYS(&groom, counts[FURCL_COUNT_SHADOWS], true, load_shadow_ray, store_shadow_hit, &rays);
}
#endif
