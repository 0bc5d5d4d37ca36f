/* Stage after the first intersect_closest, of films with layers of what camera rays meet.

   `sums` holds FURCL_FIRST_HIT_SUMS a pixel (furcl/rendering/layers.py), `nearest` the depth and the strand + 1 of the
   nearest hit, the ranks pairs of id and samples.

   Objects of cryptomatte are the grooms, the surface, the meshes and the lamps, in that order.

   reads    state: ORIGIN, DIR, HIT_*; the groom, meshes, lamps, plan (with FURCL_PLANNED), shutter (with
            FURCL_CAMERA_MOTION)
   writes   sums, nearest, ranks
   over     the pixels of the wave, as add_to_film
   next     shade_escaped */
#include "core/paths.clh"
#include "geometry/frame.clh"
#include "geometry/strand.clh"
#include <layers>
#if FURCL_CAMERA_MOTION
#include "camera/shutter.clh"
#include "core/path_numbers.clh"
#endif
#if FURCL_SURFACE
#include <surface>
#endif
#if FURCL_MESHES
#include <meshes>
#endif
#if FURCL_AREA_LAMPS
#include <lamps>
#endif

/* What is in the place of a strand where the nearest hit is on a surface, a mesh or a lamp. */
#define NO_STRAND 0xfffffffeu

typedef struct {
    float3 position, normal, tangent;
    uint segment;  /* as HIT_SEGMENT */
    float u;       /* as HIT_U */
} FirstHit;

/* What is met beside fibres, and where from. */
typedef struct {
#if FURCL_SURFACE
    const SurfaceParams* surface;
#endif
#if FURCL_MESHES
    __global const float4* corners;
    __global const float* shading;
#endif
#if FURCL_AREA_LAMPS
    __global const float* light;
#endif
    uint unused;
} Others;

#if FURCL_SURFACE || FURCL_MESHES || FURCL_AREA_LAMPS
/* The normal of what a ray met at distance t, which is no fibre. */
static inline float3 normal_of_other(
    const Others* others, const FirstHit* hit, float3 origin, float3 direction, float t)
{
#if FURCL_SURFACE
    if (hit->segment == FURCL_SURFACE_HIT) return surface_point(others->surface, origin, direction, t).normal;
#endif
#if FURCL_AREA_LAMPS
    if (hit->segment == FURCL_LAMP_HIT) {
        const float3 normal = lamp_normal(lamp_at(others->light, (uint)hit->u), hit->position);
        return dot(normal, direction) > 0.0f ? -normal : normal;
    }
#endif
#if FURCL_MESHES
    return mesh_point(others->corners, others->shading, hit->segment, origin, direction).normal;
#else
    return -direction;
#endif
}
#endif

static inline FirstHit first_hit(Paths paths, uint slot, const Groom* groom, const Others* others)
{
    FirstHit hit;
    hit.segment = path_uint(paths, PS_HIT_SEGMENT, slot);
    hit.u = path_float(paths, PS_HIT_U, slot);
    const float3 direction = path_float3(paths, PS_DIR, slot);
#if FURCL_SURFACE || FURCL_MESHES || FURCL_AREA_LAMPS
    if (hit.segment >= FURCL_TRIANGLE) {
        const float3 origin = path_float3(paths, PS_ORIGIN, slot);
        const float t = path_float(paths, PS_HIT_T, slot);
        hit.position = origin + t * direction;
        hit.normal = normal_of_other(others, &hit, origin, direction, t);
        hit.tangent = (float3)(0.0f);
        return hit;
    }
#endif
    const uint segment = FURCL_SEGMENT(paths, hit.segment);
    const float time = path_time(paths, slot);
    const float3 from = vertex_at_time(groom->vertices, segment, time).xyz;
    const float3 along = vertex_at_time(groom->vertices, segment + 1u, time).xyz - from;
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
    , __global uint* groom_ranks, __global const uint* groom_starts, const uint n_grooms, const uint first_lamp
#endif
#if FURCL_SURFACE
    , const SurfaceParams surface
#endif
#if FURCL_MESHES
    , __global const float4* corners, __global const float* shading
#endif
#if FURCL_AREA_LAMPS
    , __global const float* light
#endif
#if FURCL_PLANNED
    , __global const uint* plan
#endif
#if FURCL_CAMERA_MOTION
    , __global const float* shutter
#endif
    )
{
    const Paths paths = {state, wave.n_slots};
    const Groom groom = groom_of(blocks, vertices, strands
#if FURCL_MESHES
        , corners
#endif
        );
    Others others;
#if FURCL_SURFACE
    others.surface = &surface;
#endif
#if FURCL_MESHES
    others.corners = corners;
    others.shading = shading;
#endif
#if FURCL_AREA_LAMPS
    others.light = light;
#endif
    const PixelSlots slots = slots_of_pixel(paths, &wave,
#if FURCL_PLANNED
        plan,
#endif
        get_global_id(0));
    if (slots.first >= slots.end) return;
    const uint pixel = film_pixel(&wave, slots.pixel);
    for (uint slot = slots.first; slot < slots.end; slot += slots.step) {
        if (path_uint(paths, PS_HIT_SEGMENT, slot) == FURCL_NO_SEGMENT) continue;
        const FirstHit hit = first_hit(paths, slot, &groom, &others);
        const bool fibre = hit.segment < FURCL_TRIANGLE;
#if FURCL_CAMERA_MOTION
        const PixelSample p = pixel_of_slot(paths, &wave, slot);
        const Camera seen_by =
            moved_camera(&camera, shutter, path_numbers(&wave, p.index, p.sample, DIM_TIME).x);
#else
        const Camera seen_by = camera;
#endif
        const float depth = dot(hit.position - seen_by.origin.xyz, seen_by.forward.xyz);
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
        values[FURCL_SUM_STRAND_U] = fibre ? along_strand(&groom, hit.segment, hit.u, path_time(paths, slot)) : 0.0f;
#endif
        add_to_sums(all_sums + (size_t)pixel * FURCL_FIRST_HIT_SUMS, values, FURCL_FIRST_HIT_SUMS);
#if FURCL_STRAND_IDS
        uint strand = NO_STRAND;
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
#if FURCL_MESHES
        if (hit.segment >= FURCL_TRIANGLE && hit.segment < FURCL_LAMP_HIT)
            object += FURCL_SURFACE + mesh_of_triangle(shading, hit.segment);
#endif
#if FURCL_AREA_LAMPS
        if (hit.segment == FURCL_LAMP_HIT) object = first_lamp + (uint)hit.u;
#endif
        count_id(groom_ranks + 2u * FURCL_RANKED_IDS * (size_t)pixel, object);
#endif
    }
}
