/* Stage 5 of fibres. The next ray and the light sample of paths that met a fibre. */
#include "core/continue_path.clh"
#include "fibre/sampler.clh"
#include "geometry/fibre_hits.clh"
#if FURCL_ABSORPTION >= FURCL_ABSORPTION_STRAND
#include "fibre/absorption.clh"
#endif
#if FURCL_LIGHT_SAMPLING
#include "light/lights.clh"
#if FURCL_MODE != FURCL_MODE_FAR
#include "fibre/hit_offsets.clh"
#endif
#endif

/* The point on the axis and the radius (w) where a path met a fibre. */
static inline float4 point_on_fibre(Paths paths, uint slot, __global const StoredVertex* vertices)
{
    const uint segment = FURCL_SEGMENT(paths, path_uint(paths, PS_HIT_SEGMENT, slot));
    const float time = path_time(paths, slot);
    return mix(vertex_at_time(vertices, segment, time), vertex_at_time(vertices, segment + 1, time),
               path_float(paths, PS_HIT_U, slot));
}

#if FURCL_LIGHT_SAMPLING
/* Adds the light sample, at an h of its own, weighed against samples of the fibre in its direction
   (docs/model.md, Light samples). */
static inline void add_light_sample(
    Bounce* bounce, const FibreFrame* frame, const Fibre* fibre, const Incidence* in, float4 at,
    __global const float* light, float4 xi, float4 choice, float3 sampler_xi
#if FURCL_MODE != FURCL_MODE_FAR
    , Offsets within
#endif
#if FURCL_LAYER_LOBES
    , Spectrum* of_lobe
#endif
    )
{
    const ChosenLight chosen = choose_light(light, at.xyz, xi.xy, choice);
    const LightSample sample = chosen.sample;
    const float3 w = frame_angles(frame, sample.direction);
    bounce->light_direction = sample.direction;
    bounce->light_distance = sample.distance;
#if FURCL_AREA_LAMPS
    bounce->light_lamp = chosen.lamp;
#endif
#if FURCL_LAYER_LOBES
    Spectrum before_lobe[FURCL_LOBES + 1];
#endif
#if FURCL_MODE != FURCL_MODE_FAR
    const LobeTerms towards = value_towards_within(fibre, in, w, within, xi.zw, sampler_xi
#else
    const LobeTerms towards = value_towards(fibre, in, w, xi.zw, sampler_xi
#endif
#if FURCL_LAYER_LOBES
        , before_lobe
#endif
        );
    bounce->light = sample.pdf > 0.0f
        ? towards.value * spectrum_from3(sample.radiance) / (sample.pdf + rival_density(&chosen, towards.pdf))
        : spectrum(0.0f);
#if FURCL_LAYER_LOBES
    const Spectrum scale = sample.pdf > 0.0f
        ? spectrum_from3(sample.radiance) / (sample.pdf + rival_density(&chosen, towards.pdf))
        : spectrum(0.0f);
    for (uint p = 0u; p < FURCL_LOBES; p++)
        of_lobe[p] = (before_lobe[p + 1u] - before_lobe[p]) * scale;
#endif
}
#endif

#if FURCL_LAYER_LOBES

/* The layer of a lobe of the material. */
static inline uint layer_of_lobe(uint lobe) { return (uint)(FURCL_LAYERS_OF_LOBES >> (4u * lobe)) & 15u; }

#if FURCL_LIGHT_SAMPLING
/* Keeps the first light sample lobe by lobe, for intersect_shadow to say whether it is seen. */
static inline void keep_first_light(Paths paths, uint slot, const Spectrum* of_lobe, PathQueues to)
{
    for (uint i = 0u; i < FURCL_LOBE_LAYERS; i++)
        set_path_spectrum(paths, PS_FIRST_LIGHT_0 + FURCL_CHANNELS * i, slot, spectrum(0.0f));
    for (uint p = 0u; to.shadow && p < FURCL_LOBES; p++)
        set_path_spectrum(paths, PS_FIRST_LIGHT_0 + FURCL_CHANNELS * layer_of_lobe(p), slot,
                          of_lobe[p] * to.light_scale);
    set_path_uint(paths, PS_FIRST_SEEN, slot, 0u);
}
#endif

#endif

/* The next ray, of weight 0 where no lobe was chosen. */
static inline Bounce scatter_at_fibre(
    Paths paths, uint slot, const FibreFrame* frame, const Fibre* fibre, const Incidence* in, float4 at, float4 xi
#if FURCL_LIGHT_SAMPLING && FURCL_MODE != FURCL_MODE_FAR
    , Offsets within
#endif
    )
{
    Bounce bounce;
    bounce.origin = at.xyz;
    bounce.from_segment = path_uint(paths, PS_HIT_SEGMENT, slot);
    bounce.weight = spectrum(0.0f);
    const uint lobe = path_uint(paths, PS_LOBE, slot);
#if FURCL_LAYER_LOBES
    bounce.first = lobe < FURCL_LOBES ? layer_of_lobe(lobe) : 0u;
#elif FURCL_LIGHT_LAYERS
    bounce.first = 0u;
#endif
    if (lobe >= FURCL_LOBES) return bounce;
    const BcsdfAtOffset b = bcsdf_of_lobe(lobe, fibre, in, path_float(paths, PS_OFFSET_H, slot));
    const float3 d = lobe_sample_direction(lobe, fibre, &b, xi);
    bounce.direction = unit_vector(frame_direction(frame, d.x, d.y, d.z));
#if FURCL_ALL_LOBES
    bounce.weight = all_lobes_value_over_pdf(fibre, in, b.h, d);
#else
    bounce.weight = lobe_value_over_pdf(lobe, fibre, &b, d.x, d.y, d.z) * (1.0f / path_float(paths, PS_JOINT, slot));
#endif
#if FURCL_LIGHT_SAMPLING && FURCL_MODE != FURCL_MODE_FAR
    bounce.pdf = direction_density_within(fibre, in, within, b.h, d);
#elif FURCL_LIGHT_SAMPLING
    bounce.pdf = direction_density(fibre, in, d).sum;
#endif
    return bounce;
}

/* Continues paths that met a fibre: next ray, light sample, Russian roulette.

   reads    state: DIR, HIT_*, LOBE, OFFSET_H, JOINT, THROUGHPUT; vertices, material, light, absorption
            (where strands or points have values)
   writes   state: ORIGIN, DIR, FROM_SEGMENT, THROUGHPUT, DIR_PDF, SHADOW_*; next queue, shadow queue
   over     the hit queue of its material, of number `queue`, FURCL_PATHS_PER_ITEM a work-item
   next     intersect_shadow (with FURCL_LIGHT_SAMPLING), then intersect_closest */
__kernel void shade(
    __global float* state, __global const uint* hit_queues, __global uint* next_queue,
    __global uint* shadow_queue, __global uint* counts, const Wave wave, const uint depth,
    const uint queue, __global const StoredVertex* vertices, __global const float* material,
    __global const float* light
#if FURCL_LEARNING
    , __global const float* table, __global uint* records
#endif
#if FURCL_ABSORPTION >= FURCL_ABSORPTION_STRAND
    , __global const uint* absorption, __global const uint* strands
#endif
#if FURCL_LIGHT_SAMPLING && FURCL_MODE == FURCL_MODE_MULTISCALE
    , const Camera camera
#endif
    )
{
    const Entries entries = entries_of_item(counts[FURCL_COUNT_HITS + queue]);
    const Paths paths = {state, wave.n_slots};
    __global const uint* hit_queue = hit_queues + (size_t)queue * wave.n_slots;
    Fibre fibre = fibre_of(material);
#if FURCL_ABSORPTION >= FURCL_ABSORPTION_STRAND
    const Absorption values = absorption_of(absorption, strands);
#endif
#if FURCL_LEARNING
    const Learned learned = learned_of(table, records, &wave);
#endif
    Appended next, shadows;
    next.n = shadows.n = 0u;
    fetch_vertices_early(paths, hit_queue, entries, vertices);
    for (uint first = 0; first < FURCL_PATHS_PER_ITEM && first < entries.n; first += FURCL_LANES) {
        const FibreHits hits = fibre_hits_from(first, paths, hit_queue, entries, &wave,
                                               bounce_dimension(depth, DIM_DIRECTION), vertices);
#if FURCL_LIGHT_SAMPLING
        const Lanes4 light_xi = path_number_lanes(&wave, hits.pixel, hits.sample,
                                                  bounce_dimension(depth, DIM_LIGHT));
#endif
        /* Of roulette and, for light samples of lobes whose h it draws, of the sampler. */
        bool needed = roulette_plays(&wave, depth);
#if FURCL_LIGHT_SAMPLING && ((FURCL_LOBE_MASK & ~FURCL_H_GIVEN_PHI) || FURCL_MODE == FURCL_MODE_MULTISCALE)
        needed = true;
#endif
        Lanes4 ending_xi = {0.0f, 0.0f, 0.0f, 0.0f};
        if (needed)
            ending_xi = path_number_lanes(&wave, hits.pixel, hits.sample,
                                          bounce_dimension(depth, DIM_ROULETTE));
        const uint n = lanes_in_use(first, entries);
        for (uint k = 0; k < n; k++) {
            const uint slot = hits.slot[k];
#if FURCL_ABSORPTION >= FURCL_ABSORPTION_STRAND
            take_absorption(&fibre, values, paths, slot);
#endif
            const FibreFrame frame = frame_of_lane(&hits.frames, k);
            const Incidence in = incidence_at(&fibre, frame.sin_theta, frame.cos_theta);
            const float4 at = point_on_fibre(paths, slot, vertices);
#if FURCL_LIGHT_SAMPLING && FURCL_MODE != FURCL_MODE_FAR
            const Offsets within = offsets_of_hit(paths, slot, depth, &wave, vertices, &frame
#if FURCL_MODE == FURCL_MODE_MULTISCALE
                , &camera, uint_lane(&hits.pixel, k), uint_lane(&hits.sample, k)
#endif
                );
#endif
            Bounce bounce =
                scatter_at_fibre(paths, slot, &frame, &fibre, &in, at, lane4(&hits.xi, k)
#if FURCL_LIGHT_SAMPLING && FURCL_MODE != FURCL_MODE_FAR
                    , within
#endif
                    );
#if FURCL_LIGHT_SAMPLING
            float4 choice = (float4)(0.0f);
#if FURCL_LAMPS
            choice = light_choice_numbers(&wave, uint_lane(&hits.pixel, k),
                                          uint_lane(&hits.sample, k), depth);
#endif
#if FURCL_LAYER_LOBES
            Spectrum of_lobe[FURCL_LOBES];
#endif
            add_light_sample(&bounce, &frame, &fibre, &in, at, light, lane4(&light_xi, k), choice,
                             lane4(&ending_xi, k).yzw
#if FURCL_MODE != FURCL_MODE_FAR
                             , within
#endif
#if FURCL_LAYER_LOBES
                             , of_lobe
#endif
                             );
#endif
            const PathQueues to = continue_path(paths, slot, lane(&ending_xi.x, k), &wave, depth, &bounce
#if FURCL_LEARNING
                , &learned
#endif
                );
#if FURCL_LAYER_LOBES && FURCL_LIGHT_SAMPLING
            if (depth == 0u) keep_first_light(paths, slot, of_lobe, to);
#endif
            if (to.next) append_slot(&next, slot);
            if (to.shadow) append_slot(&shadows, slot);
        }
    }
    append_all(paths, &next, next_queue, counts + FURCL_COUNT_NEXT);
#if FURCL_LIGHT_SAMPLING
    append_all(paths, &shadows, shadow_queue, counts + FURCL_COUNT_SHADOWS);
#endif
}
