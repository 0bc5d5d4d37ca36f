/* Stage after the first intersect_closest, of films with layers of what camera rays meet.

   `sums` holds FURCL_FIRST_HIT_SUMS a pixel (furcl/rendering/layers.py), `nearest` the depth and the strand + 1 of the
   nearest hit, the ranks pairs of id and samples.

   reads    state: ORIGIN, DIR, HIT_*; the groom, plan (with FURCL_PLANNED)
   writes   sums, nearest, ranks
   over     the pixels of the wave, as add_to_film
   next     shade_escaped */
#include "core/paths.clh"
#include "geometry/frame.clh"
#include "geometry/strand.clh"
#include <layers>
#if FURCL_SURFACE
#include <surface>
#endif

/* What is in the place of a strand where the nearest hit is on a surface. */
#define ON_SURFACE 0xfffffffeu

typedef struct {
    float3 position, normal, tangent;
    uint segment;  /* or FURCL_SURFACE_HIT */
    float u;
} FirstHit;

static inline FirstHit first_hit(Paths paths, uint slot, const Groom* groom
#if FURCL_SURFACE
    , const SurfaceParams* surface
#endif
    )
{
    FirstHit hit;
    hit.segment = path_uint(paths, PS_HIT_SEGMENT, slot);
    hit.u = path_float(paths, PS_HIT_U, slot);
    const float3 direction = path_float3(paths, PS_DIR, slot);
#if FURCL_SURFACE
    if (hit.segment == FURCL_SURFACE_HIT) {
        const float3 origin = path_float3(paths, PS_ORIGIN, slot);
        const float t = path_float(paths, PS_HIT_T, slot);
        hit.position = origin + t * direction;
        hit.normal = surface_point(surface, origin, direction, t).normal;
        hit.tangent = (float3)(0.0f);
        return hit;
    }
#endif
    const uint segment = FURCL_SEGMENT(paths, hit.segment);
    const float3 from = vertex_at(groom->vertices, segment).xyz;
    const float3 along = vertex_at(groom->vertices, segment + 1u).xyz - from;
    const FibreFrame frame = fibre_frame(along, -direction);
    hit.position = from + hit.u * along;
    hit.normal = frame.across;
    hit.tangent = frame.tangent;
    return hit;
}

__kernel void add_first_hits(
    __global float* state, __global float2* all_sums, const Wave wave, const Camera camera,
    __global const uint* blocks, __global const StoredVertex* vertices, __global const uint* strands
#if FURCL_STRAND_IDS
    , __global const uint* ends_before
#endif
#if FURCL_NEAREST
    , __global uint* all_nearest
#endif
#if FURCL_LAYER_CRYPTOMATTE_STRAND
    , __global uint* strand_ranks
#endif
#if FURCL_LAYER_CRYPTOMATTE_GROOM
    , __global uint* groom_ranks, __global const uint* groom_starts, const uint n_grooms
#endif
#if FURCL_SURFACE
    , const SurfaceParams surface
#endif
#if FURCL_PLANNED
    , __global const uint* plan
#endif
    )
{
    const Paths paths = {state, wave.n_slots};
    const Groom groom = groom_of(blocks, vertices, strands);
    const PixelSlots slots = slots_of_pixel(paths, &wave,
#if FURCL_PLANNED
        plan,
#endif
        get_global_id(0));
    if (slots.first >= slots.end) return;
    const uint pixel = film_pixel(&wave, slots.pixel);
    for (uint slot = slots.first; slot < slots.end; slot += slots.step) {
        if (path_uint(paths, PS_HIT_SEGMENT, slot) == FURCL_NO_SEGMENT) continue;
#if FURCL_AREA_LAMPS
        if (path_uint(paths, PS_HIT_SEGMENT, slot) == FURCL_LAMP_HIT) continue;
#endif
        const FirstHit hit = first_hit(paths, slot, &groom
#if FURCL_SURFACE
            , &surface
#endif
            );
        const bool fibre = hit.segment != FURCL_SURFACE_HIT;
        const float depth = dot(hit.position - camera.origin.xyz, camera.forward.xyz);
        float values[FURCL_FIRST_HIT_SUMS];
        values[FURCL_SUM_HITS] = 1.0f;
#if FURCL_SUM_FIBRE_HITS >= 0
        values[FURCL_SUM_FIBRE_HITS] = fibre ? 1.0f : 0.0f;
#endif
#if FURCL_LAYER_DEPTH
        values[FURCL_SUM_DEPTH] = depth;
#endif
#if FURCL_LAYER_POSITION
        put_vector(values + FURCL_SUM_POSITION, hit.position);
#endif
#if FURCL_LAYER_NORMAL
        put_vector(values + FURCL_SUM_NORMAL, hit.normal);
#endif
#if FURCL_LAYER_TANGENT
        put_vector(values + FURCL_SUM_TANGENT, hit.tangent);
#endif
#if FURCL_LAYER_STRAND_U
        values[FURCL_SUM_STRAND_U] = fibre ? along_strand(&groom, hit.segment, hit.u) : 0.0f;
#endif
        add_to_sums(all_sums + (size_t)pixel * FURCL_FIRST_HIT_SUMS, values, FURCL_FIRST_HIT_SUMS);
#if FURCL_STRAND_IDS
        uint strand = ON_SURFACE;
        if (fibre) strand = strand_of_vertex(&groom, ends_before, hit.segment);
#endif
#if FURCL_NEAREST
        __global uint* nearest = all_nearest + 2u * (size_t)pixel;
        if (nearest[1] == 0u || depth < as_float(nearest[0])) {
            nearest[0] = as_uint(depth);
            nearest[1] = strand + 1u;
        }
#endif
#if FURCL_LAYER_CRYPTOMATTE_STRAND
        if (fibre) count_id(strand_ranks + 2u * FURCL_RANKED_IDS * (size_t)pixel, strand);
#endif
#if FURCL_LAYER_CRYPTOMATTE_GROOM
        uint object = n_grooms;
        if (fibre) while (groom_starts[--object] > hit.segment) {}
        count_id(groom_ranks + 2u * FURCL_RANKED_IDS * (size_t)pixel, object);
#endif
    }
}
