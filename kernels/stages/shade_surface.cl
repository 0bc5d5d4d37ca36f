/* Stage 4 of surfaces. The next ray and the light sample of paths that met a surface or a mesh. */
#include "core/continue_path.clh"
#include "core/path_numbers.clh"
#include "surface/diffuse.clh"
#if FURCL_SURFACE
#include <surface>
#endif
#if FURCL_MESHES
#include <meshes>
#endif
#if FURCL_LIGHT_SAMPLING
#include "light/lights.clh"
#endif

#if FURCL_MESH_EMISSION
/* The light of a mesh where the ray of a path met it, weighed against light samples. */
static inline Spectrum emitted_at(
    const SurfacePoint* at, Paths paths, uint slot, __global const float* light, float3 origin, float3 direction)
{
#if FURCL_LIGHT_SAMPLING && FURCL_LAMP_TRIANGLE
    const float pdf = path_float(paths, PS_DIR_PDF, slot);
    if (at->lamp != FURCL_NO_LAMP && pdf > 0.0f) {
        const float density = lamp_density(
            lamp_at(light, at->lamp), origin, direction, path_float(paths, PS_HIT_T, slot));
        return weight_of_lamp(light, at->lamp, density, origin, pdf) * at->emission;
    }
#endif
    return at->emission;
}
#endif

static inline Bounce scatter_at_surface(
    const SurfacePoint* at, float3 out, __global const float* light, float4 xi, float4 light_xi, float4 choice)
{
    Bounce bounce;
    float pdf;
    bounce.origin = at->position;
    bounce.direction = diffuse_sample(at, xi.xy, &pdf);
    bounce.from_segment = at->from_segment;
    bounce.weight = at->albedo;
#if FURCL_MESH_COAT
    if (at->coat) {
        Reflection r;
        bounce.direction = coat_sample(at, out, xi.xyz, &r);
        pdf = r.pdf;
        bounce.weight = pdf > 0.0f ? r.value / pdf : spectrum(0.0f);
    }
#endif
#if FURCL_LIGHT_LAYERS
    bounce.first = FURCL_LOBE_LAYERS;
#endif
#if FURCL_LIGHT_SAMPLING
    bounce.pdf = pdf;
    const ChosenLight chosen = choose_light(light, at->position, light_xi.xy, choice);
    const LightSample sample = chosen.sample;
    bounce.light_direction = sample.direction;
    bounce.light_distance = sample.distance;
#if FURCL_AREA_LAMPS
    bounce.light_lamp = chosen.lamp;
#endif
    float towards = diffuse_pdf(at, sample.direction);
    Spectrum reflected = at->albedo * towards;
#if FURCL_MESH_COAT
    if (at->coat) {
        const Reflection r = coat_reflection(at, out, sample.direction);
        towards = r.pdf;
        reflected = r.value;
    }
#endif
    bounce.light = towards > 0.0f && sample.pdf > 0.0f
        ? reflected / (rival_density(&chosen, towards) + sample.pdf) * spectrum_from3(sample.radiance)
        : spectrum(0.0f);
#endif
    return bounce;
}

/* Continues paths that met a surface: light of its own, next ray, light sample, Russian roulette.

   reads    state: ORIGIN, DIR, HIT_*, THROUGHPUT, DIR_PDF; meshes, light
   writes   state: ORIGIN, DIR, FROM_SEGMENT, THROUGHPUT, RADIANCE, DIR_PDF, SHADOW_*; next queue, shadow
            queue
   over     the last hit queue, FURCL_PATHS_PER_ITEM a work-item
   next     intersect_shadow (with FURCL_LIGHT_SAMPLING), then intersect_closest */
__kernel void shade_surface(
    __global float* state, __global const uint* hit_queues, __global uint* next_queue,
    __global uint* shadow_queue, __global uint* counts, const Wave wave, const uint depth,
    __global const float* light
#if FURCL_SURFACE
    , const SurfaceParams surface
#endif
#if FURCL_MESHES
    , __global const float4* corners, __global const float* shading
#endif
#if FURCL_LEARNING
    , __global const float* table, __global uint* records
#endif
    )
{
    const Entries entries = entries_of_item(counts[FURCL_COUNT_HITS + FURCL_FIBRES]);
    const Paths paths = {state, wave.n_slots};
    __global const uint* hit_queue = hit_queues + (size_t)FURCL_FIBRES * wave.n_slots;
#if FURCL_LEARNING
    const Learned learned = learned_of(table, records, &wave);
#endif
    Appended next, shadows;
    next.n = shadows.n = 0u;
    for (uint k = 0; k < FURCL_PATHS_PER_ITEM && k < entries.n; k++) {
        const uint slot = queued_slot(paths, hit_queue, entries.begin + k);
        const PixelSample p = pixel_of_slot(paths, &wave, slot);
        const float3 origin = path_float3(paths, PS_ORIGIN, slot);
        const float3 direction = path_float3(paths, PS_DIR, slot);
        SurfacePoint at;
#if FURCL_MESHES
        const uint met = path_uint(paths, PS_HIT_SEGMENT, slot);
#if FURCL_SURFACE
        if (met == FURCL_SURFACE_HIT)
            at = surface_point(&surface, origin, direction, path_float(paths, PS_HIT_T, slot));
        else
#endif
            at = mesh_point(corners, shading, met, origin, direction);
#else
        at = surface_point(&surface, origin, direction, path_float(paths, PS_HIT_T, slot));
#endif
        const float4 xi =
            path_numbers(&wave, p.index, p.sample, bounce_dimension(depth, DIM_DIRECTION));
        float4 light_xi = (float4)(0.0f), choice = (float4)(0.0f);
#if FURCL_LIGHT_SAMPLING
#if FURCL_LAMPS
        choice = light_choice_numbers(&wave, p.index, p.sample, depth);
#endif
        light_xi = path_numbers(&wave, p.index, p.sample, bounce_dimension(depth, DIM_LIGHT));
#endif
        const Bounce bounce = scatter_at_surface(&at, -direction, light, xi, light_xi, choice);
#if FURCL_MESH_EMISSION
        const Spectrum emitted = path_spectrum(paths, PS_THROUGHPUT, slot) *
                                 emitted_at(&at, paths, slot, light, origin, direction);
#endif
        float ending_xi = 0.0f;
        if (roulette_plays(&wave, depth))
            ending_xi =
                path_numbers(&wave, p.index, p.sample, bounce_dimension(depth, DIM_ROULETTE)).x;
        const PathQueues to = continue_path(paths, slot, ending_xi, &wave, depth, &bounce
#if FURCL_LEARNING
            , &learned
#endif
            );
#if FURCL_MESH_EMISSION
        set_path_spectrum(paths, PS_RADIANCE, slot, path_spectrum(paths, PS_RADIANCE, slot) + emitted);
#if FURCL_SPLIT_DIRECT
        /* What is met after one scattering and shines itself: direct light. */
        if (depth == 1u)
            set_path_spectrum(paths, PS_DIRECT, slot, path_spectrum(paths, PS_DIRECT, slot) + emitted);
#endif
#endif
        if (to.next) append_slot(&next, slot);
        if (to.shadow) append_slot(&shadows, slot);
    }
    append_all(paths, &next, next_queue, counts + FURCL_COUNT_NEXT);
#if FURCL_LIGHT_SAMPLING
    append_all(paths, &shadows, shadow_queue, counts + FURCL_COUNT_SHADOWS);
#endif
}
