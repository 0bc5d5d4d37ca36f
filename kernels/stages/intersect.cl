/* Stage 2 of 5. Rays against the groom and the body.

   A work-item takes FURCL_RAYS_PER_ITEM rays; the vectors are inside a ray (eight lanes at a time). */
#include "surface/ellipsoid.clh"
#include "core/spectrum.clh"
#include "bvh/traversal.clh"

/* Finds what the ray of every path meets first.

   reads    state: ORIGIN, DIR, SKIP_*; the tree; active_counts: COUNT_NEXT of the bounce before
   writes   state: HIT_*; hit queue, miss queue and their lengths in counts
   over     the queue of paths that go on, FURCL_RAYS_PER_ITEM a work-item
   next     shade_escaped over the miss queue, sample_lobe_h over the hit queue */
__kernel void intersect_closest(
    __global float* state, __global const uint* queue, __global uint* hit_queue,
    __global uint* miss_queue, __global const uint* active_counts, __global uint* counts,
    const uint n_slots, const Body body, BVH_PARAMETERS)
{
#if FURCL_BODY
#define MEET_BODY(query, hit) body_query(&body, &(query), &(hit));
#define STORE_DISTANCE(slot, hit) PS_F(HIT_T, slot) = (hit).t;
#else
#define MEET_BODY(query, hit)
#define STORE_DISTANCE(slot, hit)
#endif
#define LOAD_PATH(i, query, hit) { \
    const uint slot = FURCL_AT(queue, i, n_slots); \
    query = (Query){PS_LOAD3(ORIGIN, slot), PS_LOAD3(DIR, slot), PS_F(SKIP_DISTANCE, slot), \
                    PS_U(SKIP_SEGMENT, slot)}; \
    hit = (Hit){INFINITY, 0.0f, FURCL_NO_SEGMENT}; \
    MEET_BODY(query, hit) }
#define STORE_PATH(i, hit) { \
    const uint slot = FURCL_AT(queue, i, n_slots); \
    STORE_DISTANCE(slot, hit) \
    PS_F(HIT_U, slot) = (hit).u; \
    PS_U(HIT_SEGMENT, slot) = (hit).segment; \
    if ((hit).segment == FURCL_NO_SEGMENT) \
        FURCL_AT(miss_queue, atomic_inc(counts + FURCL_COUNT_MISSES), n_slots) = slot; \
    else \
        FURCL_AT(hit_queue, atomic_inc(counts + FURCL_COUNT_HITS), n_slots) = slot; }

    TRACE_RAYS(active_counts[FURCL_COUNT_NEXT], false, LOAD_PATH, STORE_PATH);
}

#if FURCL_LIGHT_SAMPLING
/* Adds the light sample of every path that nothing keeps from it.

   reads    state: ORIGIN, SHADOW_*, SKIP_SEGMENT; the tree
   writes   state: RADIANCE
   over     the shadow queue, FURCL_RAYS_PER_ITEM a work-item
   next     intersect_closest */
__kernel void intersect_shadow(
    __global float* state, __global const uint* shadow_queue, __global const uint* counts,
    const uint n_slots, const Body body, BVH_PARAMETERS)
{
/* Behind the body the search for fibres ends where it begins. */
#if FURCL_BODY
#define MEET_BODY_FIRST(query, hit) if (body_query(&body, &(query), &(hit))) (hit).t = 0.0f;
#else
#define MEET_BODY_FIRST(query, hit)
#endif
#define LOAD_SHADOW(i, query, hit) { \
    const uint slot = FURCL_AT(shadow_queue, i, n_slots); \
    query = (Query){PS_LOAD3(ORIGIN, slot), PS_LOAD3(SHADOW_DIR, slot), \
                    PS_F(SHADOW_SKIP_DISTANCE, slot), PS_U(SKIP_SEGMENT, slot)}; \
    hit = (Hit){INFINITY, 0.0f, FURCL_NO_SEGMENT}; \
    MEET_BODY_FIRST(query, hit) }
#define STORE_SHADOW(i, hit) { \
    const uint slot = FURCL_AT(shadow_queue, i, n_slots); \
    if ((hit).segment == FURCL_NO_SEGMENT) \
        PS_STORE_SPECTRUM(RADIANCE, slot, \
            PS_LOAD_SPECTRUM(RADIANCE, slot) + PS_LOAD_SPECTRUM(SHADOW_RADIANCE, slot)); }

    TRACE_RAYS(counts[FURCL_COUNT_SHADOWS], true, LOAD_SHADOW, STORE_SHADOW);
}
#endif

#define LOAD_RAY(i, query, hit) { \
    const float4 o = origins[i], d = directions[i]; \
    query = (Query){o.xyz, d.xyz, o.w, skip_segment[i]}; \
    hit = (Hit){d.w, 0.0f, FURCL_NO_SEGMENT}; }

/* Rays in plain arrays, for benchmarks and tests.

   reads    origins (xyz, distance skipped on the own strand), directions (xyz, t_max), skip_segment
   writes   nearest hits in (0, t_max]: t, segment, u; of a miss t_max, FURCL_NO_SEGMENT, 0
   over     rays, FURCL_RAYS_PER_ITEM a work-item */
__kernel void trace_rays(
    const uint n_rays, __global const float4* origins,
    __global const float4* directions, __global const uint* skip_segment, __global float* t,
    __global uint* segment, __global float* u, BVH_PARAMETERS)
{
#define STORE_HIT(i, hit) { t[i] = (hit).t; segment[i] = (hit).segment; u[i] = (hit).u; }
    TRACE_RAYS(n_rays, false, LOAD_RAY, STORE_HIT);
}

/* The same rays, asking only whether anything lies in (0, t_max].

   reads    as trace_rays
   writes   occluded: 1 or 0
   over     rays, FURCL_RAYS_PER_ITEM a work-item */
__kernel void trace_shadow_rays(
    const uint n_rays, __global const float4* origins,
    __global const float4* directions, __global const uint* skip_segment,
    __global uint* occluded, BVH_PARAMETERS)
{
#define STORE_OCCLUDED(i, hit) { occluded[i] = (hit).segment != FURCL_NO_SEGMENT ? 1u : 0u; }
    TRACE_RAYS(n_rays, true, LOAD_RAY, STORE_OCCLUDED);
}
