/* The device functions that render, on arrays: one work-item an element.
   Directions are float4 with the tangent as x; values have three channels whatever the build; densities of
   h are relative to h uniform over the fibre's width (fibre/sampler.clh), or within the limits that each
   element has where h has some (FURCL_MODE). */
#include "core/rng.clh"
#include "fibre/sampler.clh"
#include "geometry/frame.clh"

static inline void store_spectrum(__global float* out, Spectrum s)
{
#if FURCL_CHANNELS == 1
    out[0] = out[1] = out[2] = s;
#else
    vstore3(s, 0, out);
#endif
}

#if FURCL_MODE == FURCL_MODE_FAR
#define WITHIN_ARGUMENT
#else
#define WITHIN_ARGUMENT , __global const float2* limits
#define WITHIN(i) ((Offsets){limits[i].x, limits[i].y})
#endif

static inline FibreFrame probe_frame(float4 wo) { return fibre_frame((float3)(1, 0, 0), wo.xyz); }

/* reads h and (sin, cos) of theta; writes A_p [FURCL_LOBES][n][3]. Over n. */
__kernel void probe_attenuation(
    __global const float* h, __global const float2* theta, __global float* out, const uint n,
    __global const float* material)
{
    const uint i = get_global_id(0);
    if (i >= n) return;
    const Fibre fibre = fibre_of(material);
    const Incidence in = incidence_at(&fibre, theta[i].x, theta[i].y);
    const BcsdfAtOffset b = bcsdf_at_offset(&fibre, &in, h[i]);
    for (uint p = 0; p < FURCL_LOBES; p++)
        store_spectrum(out + 3 * ((size_t)p * n + i),
                       lobe_exists(p) ? lobe_attenuation(p, &fibre, &b) : spectrum(0.0f));
}

/* reads wo, wi, h; writes per lobe: value [FURCL_LOBES][n][3], density of (lobe, h)
   [FURCL_LOBES][n], density of wi given both [FURCL_LOBES][n]. Over n. */
__kernel void probe_evaluate(
    __global const float4* wo, __global const float4* wi, __global const float* h,
    __global float* value, __global float* joint_out, __global float* direction_pdf, const uint n,
    __global const float* material WITHIN_ARGUMENT)
{
    const uint i = get_global_id(0);
    if (i >= n) return;
    const Fibre fibre = fibre_of(material);
    const FibreFrame frame = probe_frame(wo[i]);
    const Incidence in = incidence_at(&fibre, frame.sin_theta, frame.cos_theta);
    const BcsdfAtOffset b = bcsdf_at_offset(&fibre, &in, h[i]);
    const float3 w = frame_angles(&frame, wi[i].xyz);
    float joint[FURCL_LOBES];
#if FURCL_MODE == FURCL_MODE_FAR
    joint_densities(&fibre, &in, &b, joint);
#else
    joint_densities_within(&fibre, &in, WITHIN(i), &b, joint);
#endif
    for (uint p = 0; p < FURCL_LOBES; p++) {
        const size_t at = (size_t)p * n + i;
        LobeTerms terms;
        terms.value = spectrum(0.0f);
        terms.pdf = 0.0f;
        if (lobe_exists(p)) terms = lobe_terms(p, &fibre, &b, w.x, w.y, w.z);
        store_spectrum(value + 3 * at, terms.value);
        joint_out[at] = joint[p];
        direction_pdf[at] = terms.pdf;
    }
}

/* The uniform numbers of sample i of pixel 0, or those that the caller gives. */
static inline float4 probe_numbers(
    uint seed, uint i, uint dimension, uint given, __global const float4* numbers)
{
    return given ? numbers[2u * (size_t)i + dimension]
                 : uniform4(seed, 0u, i, bounce_dimension(0u, dimension));
}

/* reads wo, numbers [n][2] if given; writes wi, h, lobe (FURCL_LOBES where nothing was chosen),
   weight [n][3], density of (lobe, h, wi). Over n. */
__kernel void probe_sample(
    __global const float4* wo, __global float4* wi, __global float* h, __global uint* lobe,
    __global float* weight, __global float* pdf, const uint n, const uint seed, const uint given,
    __global const float4* numbers, __global const float* material WITHIN_ARGUMENT)
{
    const uint i = get_global_id(0);
    if (i >= n) return;
    const Fibre fibre = fibre_of(material);
    const FibreFrame frame = probe_frame(wo[i]);
    const Incidence in = incidence_at(&fibre, frame.sin_theta, frame.cos_theta);
    const float4 xi = probe_numbers(seed, i, DIM_LOBE, given, numbers);
#if FURCL_MODE == FURCL_MODE_FAR
    const LobeAndOffset chosen = sample_lobe_and_offset(&fibre, &in, xi.xyz);
#else
    const LobeAndOffset chosen = sample_within(&fibre, &in, WITHIN(i), xi.xyz);
#endif
    h[i] = chosen.h;
    lobe[i] = min(chosen.lobe, (uint)FURCL_LOBES);
    wi[i] = (float4)(0.0f);
    pdf[i] = 0.0f;
    store_spectrum(weight + 3 * (size_t)i, spectrum(0.0f));
    if (chosen.lobe >= FURCL_LOBES) return;
    const BcsdfAtOffset b = bcsdf_at_offset(&fibre, &in, chosen.h);
    const float3 d = lobe_sample_direction(
        chosen.lobe, &fibre, &b, probe_numbers(seed, i, DIM_DIRECTION, given, numbers));
    wi[i] = (float4)(frame_direction(&frame, d.x, d.y, d.z), 0.0f);
    pdf[i] = chosen.joint * lobe_terms(chosen.lobe, &fibre, &b, d.x, d.y, d.z).pdf;
#if FURCL_ALL_LOBES
    store_spectrum(weight + 3 * (size_t)i, all_lobes_value_over_pdf(&fibre, &in, b.h, d));
#else
    store_spectrum(weight + 3 * (size_t)i,
                   (1.0f / chosen.joint) * lobe_value_over_pdf(chosen.lobe, &fibre, &b, d.x, d.y, d.z));
#endif
}

#if FURCL_LIGHT_SAMPLING
/* reads wo, wi; writes an estimate of the far field towards wi [n][3], or of the mean within the limits, and
   about the density of samples there. Over n. */
__kernel void probe_towards(
    __global const float4* wo, __global const float4* wi, __global float* value, __global float* pdf,
    const uint n, const uint seed, __global const float* material WITHIN_ARGUMENT)
{
    const uint i = get_global_id(0);
    if (i >= n) return;
    const Fibre fibre = fibre_of(material);
    const FibreFrame frame = probe_frame(wo[i]);
    const Incidence in = incidence_at(&fibre, frame.sin_theta, frame.cos_theta);
    const float4 xi = uniform4(seed, 0u, i, bounce_dimension(0u, DIM_LIGHT));
    const float4 sampler_xi = uniform4(seed, 0u, i, bounce_dimension(0u, DIM_ROULETTE));
    const float3 w = frame_angles(&frame, wi[i].xyz);
#if FURCL_MODE == FURCL_MODE_FAR
    const LobeTerms towards = value_towards(&fibre, &in, w, xi.zw, sampler_xi.yzw);
#else
    const LobeTerms towards = value_towards_within(&fibre, &in, w, WITHIN(i), xi.zw, sampler_xi.yzw);
#endif
    store_spectrum(value + 3 * (size_t)i, towards.value);
    pdf[i] = towards.pdf;
}
#endif
