/* Stage 4 of 5. Light found by rays that left the groom (shade_escaped) and the next ray of paths
   that met a fibre or the body (shade). */
#include "light/environment.clh"
#include "core/hits.clh"
#include "fibre/attenuation_tables.clh"

/* Adds the environment to paths that escaped; they end here.

   reads    state: DIR, THROUGHPUT, DIR_PDF; environment
   writes   state: RADIANCE
   over     the miss queue, FURCL_PATHS_PER_ITEM a work-item
   next     film */
__kernel void shade_escaped(
    __global float* state, __global const uint* miss_queue, __global const uint* counts,
    const Wave wave, __global const float* environment)
{
    const uint n_misses = counts[FURCL_COUNT_MISSES];
    const uint n_slots = wave.n_slots;
    FOR_QUEUE_ENTRIES(i, n_misses) {
        const uint slot = FURCL_AT(miss_queue, i, n_slots);
        const float3 direction = PS_LOAD3(DIR, slot);
        Spectrum radiance = spectrum_from3(environment_radiance(environment, direction));
#if FURCL_LIGHT_SAMPLING
        /* Balance heuristic against the light sample of the vertex before; camera rays have none. */
        const float pdf = PS_F(DIR_PDF, slot);
        if (pdf > 0.0f) radiance *= pdf / (pdf + environment_pdf(environment, direction));
#endif
        PS_STORE_SPECTRUM(RADIANCE, slot,
            PS_LOAD_SPECTRUM(RADIANCE, slot) + PS_LOAD_SPECTRUM(THROUGHPUT, slot) * radiance);
    }
}

/* Where the next ray starts, where it goes, and what it is worth. */
typedef struct {
    float3 origin, direction;
    uint skip_segment;
    float skip_distance;
    Spectrum weight;
#if FURCL_LIGHT_SAMPLING
    float pdf;              /* of direction, given h */
    float3 light_direction;
    float light_skip_distance;
    Spectrum light;         /* radiance from there, weighted; zero where there is none */
#endif
} Bounce;

/* On the fibre a ray starts on the axis: nearer than four radii over the sine of its angle to the
   tangent it has not left this strand, however the strand bends. */
static inline float distance_inside(float radius, float cos_theta)
{
    return 4.0f * radius / fmax(cos_theta, 1e-6f);
}

static inline Bounce scatter_at_fibre(
    __global float* state, uint n_slots, uint slot, const FibreFrame* frame, const FibreParams* fibre,
    __global const StoredVertex* vertices, __global const float* tables, __global const float* profiles,
    __global const float* environment, float4 u, float4 light_u)
{
    Bounce bounce;
    const uint segment = PS_U(HIT_SEGMENT, slot);
    const float4 root = VERTEX(vertices, FURCL_INDEX(segment, FURCL_N_VERTICES));
    const float4 tip = VERTEX(vertices, FURCL_INDEX(segment + 1, FURCL_N_VERTICES));
    const Incidence in = incidence_at(fibre, frame->sin_theta, frame->cos_theta);
    const uint lobe = PS_U(LOBE, slot);
    const float joint = PS_F(JOINT, slot);
#if FURCL_LIGHT_SAMPLING
    const BcsdfAtOffset b = bcsdf_at_offset(fibre, profiles, &in, PS_F(OFFSET_H, slot));
#else
    const BcsdfAtOffset b = bcsdf_of_lobe(lobe, fibre, profiles, &in, PS_F(OFFSET_H, slot));
#endif
    const float3 d = lobe_sample_direction(lobe, fibre, profiles, &b, u);
    const float4 at = mix(root, tip, PS_F(HIT_U, slot));
    bounce.origin = at.xyz;
    bounce.direction = unit_vector(frame_direction(frame, d.x, d.y, d.z));
    bounce.skip_segment = segment;
    bounce.skip_distance = distance_inside(at.w, d.y);
    /* h is uniform over the fibre's width: density 1/2. */
    bounce.weight = (0.5f / joint) * lobe_value_over_pdf(lobe, fibre, profiles, &b, d.x, d.z);
#if FURCL_LIGHT_SAMPLING
    /* A light sample uses the same h, whose density is the sum of q over the lobes, and all lobes
       there; each is weighted against being sampled itself (SPEC 4.6). */
    float joints[FURCL_LOBES], density_h = 0.0f;
    joint_densities(fibre, tables, &in, &b, joints);
    for (uint p = 0; p < FURCL_LOBES; p++) density_h += joints[p];
    bounce.pdf = joint * lobe_terms(lobe, fibre, profiles, &b, d.x, d.y, d.z).pdf / density_h;
    float light_pdf;
    bounce.light_direction = environment_sample(environment, light_u.xy, &light_pdf);
    const float3 w = frame_angles(frame, bounce.light_direction);
    bounce.light_skip_distance = distance_inside(at.w, w.y);
    Spectrum scattered = SPECTRUM(0.0f);
    for (uint p = 0; p < FURCL_LOBES; p++) {
        if (!lobe_exists(p)) continue;
        const LobeTerms terms = lobe_terms(p, fibre, profiles, &b, w.x, w.y, w.z);
        scattered += 0.5f * terms.value / (density_h * light_pdf + joints[p] * terms.pdf);
    }
    bounce.light = light_pdf > 0.0f
        ? scattered * spectrum_from3(environment_radiance(environment, bounce.light_direction))
        : SPECTRUM(0.0f);
#endif
    return bounce;
}

#if FURCL_BODY
/* The body is a diffuse ellipsoid. */
static inline Bounce scatter_at_body(
    __global float* state, uint n_slots, uint slot, const Body* body,
    __global const float* environment, float4 u, float4 light_u)
{
    Bounce bounce;
    const float3 p = PS_LOAD3(ORIGIN, slot) + PS_F(HIT_T, slot) * PS_LOAD3(DIR, slot);
    const float3 unit = unit_vector((p - body->centre.xyz) * body->inv_radii.xyz);
    const float3 n = unit_vector(unit * body->inv_radii.xyz);
    /* On the surface exactly, and a ten thousandth outside it. */
    bounce.origin = body->centre.xyz + 1.0001f * unit / body->inv_radii.xyz;
    const float3 t = unit_vector(cross(n, fabs(n.x) < 0.5f ? (float3)(1, 0, 0) : (float3)(0, 1, 0)));
    const float r = sqrt(u.x), up = sqrt(1.0f - u.x);
    float cos_phi;
    const float sin_phi = sincos_turns(u.y, &cos_phi);
    bounce.direction = unit_vector(r * cos_phi * t + r * sin_phi * cross(n, t) + up * n);
    bounce.skip_segment = FURCL_NO_SEGMENT;
    bounce.skip_distance = 0.0f;
    bounce.weight = spectrum_from4(body->albedo);
#if FURCL_LIGHT_SAMPLING
    bounce.pdf = fmax(up, 1e-6f) * INV_PI;
    float light_pdf;
    bounce.light_direction = environment_sample(environment, light_u.xy, &light_pdf);
    bounce.light_skip_distance = 0.0f;
    const float cos_light = dot(bounce.light_direction, n);
    const float pdf = cos_light * INV_PI;
    bounce.light = cos_light > 0.0f && light_pdf > 0.0f
        ? bounce.weight * pdf / (pdf + light_pdf) *
          spectrum_from3(environment_radiance(environment, bounce.light_direction))
        : SPECTRUM(0.0f);
#endif
    return bounce;
}
#endif

/* Whether a path that met something goes on, and whether a shadow ray is to be traced for it. */
typedef struct { bool next, shadow; } Onward;

static inline Onward shade_path(
    __global float* state, const Hits* hits, uint k, const Wave* wave, uint depth, const FibreParams* fibre,
    const Body* body, __global const StoredVertex* vertices, __global const float* tables,
    __global const float* profiles, __global const float* environment)
{
    const uint n_slots = wave->n_slots;
    const uint slot = hits->slot[k];
    const float4 u = LANES4_AT(hits->u, k);
#if FURCL_LIGHT_SAMPLING
    const float4 light_u = uniform4(wave->seed, UINT_LANE(hits->pixel, k), UINT_LANE(hits->sample, k),
                                    bounce_dimension(depth, DIM_LIGHT));
#else
    const float4 light_u = (float4)(0.0f);
#endif
    Onward onward = {false, false};
    Bounce bounce;
#if FURCL_BODY
    if (PS_U(HIT_SEGMENT, slot) == FURCL_BODY_SEGMENT)
        bounce = scatter_at_body(state, n_slots, slot, body, environment, u, light_u);
    else
#endif
    {
        /* A fibre that reflects, transmits and scatters nothing ends the path. */
        if (PS_U(LOBE, slot) >= FURCL_LOBES) return onward;
        const FibreFrame frame = frame_of_lane(&hits->frames, k);
        bounce = scatter_at_fibre(state, n_slots, slot, &frame, fibre, vertices, tables, profiles,
                                  environment, u, light_u);
    }
    const Spectrum before = PS_LOAD_SPECTRUM(THROUGHPUT, slot);
    Spectrum throughput = before * bounce.weight;
    PS_STORE3(ORIGIN, slot, bounce.origin);
    PS_U(SKIP_SEGMENT, slot) = bounce.skip_segment;
#if FURCL_LIGHT_SAMPLING
    const Spectrum light = before * bounce.light;
    if (spectrum_max(light) > 0.0f) {
        PS_STORE3(SHADOW_DIR, slot, bounce.light_direction);
        PS_F(SHADOW_SKIP_DISTANCE, slot) = bounce.light_skip_distance;
        PS_STORE_SPECTRUM(SHADOW_RADIANCE, slot, light);
        onward.shadow = true;
    }
#endif
    const float largest = spectrum_max(throughput);
    if (largest <= 0.0f) return onward;
#if FURCL_ROULETTE
    /* Survivors carry the weight of those that end: the mean is unchanged. */
    if (depth >= wave->roulette_depth && largest < 1.0f) {
        const float4 roulette =
            uniform4(wave->seed, UINT_LANE(hits->pixel, k), UINT_LANE(hits->sample, k),
                     bounce_dimension(depth, DIM_ROULETTE));
        if (roulette.x >= largest) return onward;
        throughput /= largest;
    }
#endif
    PS_STORE3(DIR, slot, bounce.direction);
    PS_F(SKIP_DISTANCE, slot) = bounce.skip_distance;
    PS_STORE_SPECTRUM(THROUGHPUT, slot, throughput);
#if FURCL_LIGHT_SAMPLING
    PS_F(DIR_PDF, slot) = bounce.pdf;
#endif
    onward.next = true;
    return onward;
}

/* Continues paths that met something: next ray, light sample, Russian roulette.

   reads    state: DIR, HIT_*, LOBE, OFFSET_H, JOINT, THROUGHPUT; vertices, tables, profiles,
            environment
   writes   state: ORIGIN, DIR, SKIP_*, THROUGHPUT, DIR_PDF, SHADOW_*; next queue, shadow queue
   over     the hit queue, FURCL_PATHS_PER_ITEM a work-item
   next     intersect_shadow (with FURCL_LIGHT_SAMPLING), then intersect_closest */
__kernel void shade(
    __global float* state, __global const uint* hit_queue, __global uint* next_queue,
    __global uint* shadow_queue, __global uint* counts, const Wave wave, const uint depth,
    const FibreParams fibre, const Body body, __global const StoredVertex* vertices,
    __global const float* tables, __global const float* profiles,
    __global const float* environment)
{
    const uint n_hits = counts[FURCL_COUNT_HITS];
    const uint n_slots = wave.n_slots;
    Appended next, shadows;
    next.n = shadows.n = 0u;
    FETCH_VERTICES_EARLY(hit_queue, n_hits, vertices);
    FOR_GROUPS_OF_HITS(first, n_hits) {
        const Hits hits = hits_from(first, state, hit_queue, n_hits, &wave,
                                    bounce_dimension(depth, DIM_DIRECTION), vertices);
        FOR_HITS(k, first, n_hits) {
            const Onward onward = shade_path(state, &hits, k, &wave, depth, &fibre, &body, vertices,
                                             tables, profiles, environment);
            if (onward.next) append_slot(&next, hits.slot[k]);
            if (onward.shadow) append_slot(&shadows, hits.slot[k]);
        }
    }
    APPEND_ALL(next, next_queue, counts + FURCL_COUNT_NEXT);
#if FURCL_LIGHT_SAMPLING
    APPEND_ALL(shadows, shadow_queue, counts + FURCL_COUNT_SHADOWS);
#endif
}
