/* The device functions that render, on arrays: one work-item an element.
   Directions are float4 with the tangent as x; values have three channels whatever the build. */
#include "geometry/frame.clh"
#include "fibre/attenuation_tables.clh"

static inline void store_spectrum(__global float* out, Spectrum s)
{
#if FURCL_CHANNELS == 1
    out[0] = out[1] = out[2] = s;
#else
    vstore3(s, 0, out);
#endif
}

static inline FibreFrame probe_frame(float4 wo) { return fibre_frame((float3)(1, 0, 0), wo.xyz); }

/* reads h and (sin, cos) of theta; writes A_p [FURCL_LOBES][n][3]. Over n. */
__kernel void probe_attenuation(
    __global const float* h, __global const float2* theta, __global float* out, const uint n,
    const FibreParams fibre, __global const float* profiles)
{
    const uint i = get_global_id(0);
    if (i >= n) return;
    const Incidence in = incidence_at(&fibre, theta[i].x, theta[i].y);
    const BcsdfAtOffset b = bcsdf_at_offset(&fibre, profiles, &in, h[i]);
    for (uint p = 0; p < FURCL_LOBES; p++)
        store_spectrum(out + 3 * ((size_t)p * n + i),
                       lobe_exists(p) ? lobe_attenuation(p, &fibre, &b) : SPECTRUM(0.0f));
}

/* reads wo, wi, h; writes per lobe: value [FURCL_LOBES][n][3], density of (lobe, h, wi)
   [FURCL_LOBES][n]. Over n. */
__kernel void probe_evaluate(
    __global const float4* wo, __global const float4* wi, __global const float* h,
    __global float* value, __global float* pdf, const uint n, const FibreParams fibre,
    __global const float* tables, __global const float* profiles)
{
    const uint i = get_global_id(0);
    if (i >= n) return;
    const FibreFrame frame = probe_frame(wo[i]);
    const Incidence in = incidence_at(&fibre, frame.sin_theta, frame.cos_theta);
    const BcsdfAtOffset b = bcsdf_at_offset(&fibre, profiles, &in, h[i]);
    const float3 w = frame_angles(&frame, wi[i].xyz);
    float joint[FURCL_LOBES];
    joint_densities(&fibre, tables, &in, &b, joint);
    for (uint p = 0; p < FURCL_LOBES; p++) {
        const size_t at = (size_t)p * n + i;
        LobeTerms terms;
        terms.value = SPECTRUM(0.0f);
        terms.pdf = 0.0f;
        if (lobe_exists(p)) terms = lobe_terms(p, &fibre, profiles, &b, w.x, w.y, w.z);
        store_spectrum(value + 3 * at, terms.value);
        pdf[at] = joint[p] * terms.pdf;
    }
}

/* Densities of lobe R, TT or TRT alone. Reads (sin, cos) of theta of wo and (s, c, azimuth, azimuth from
   the lobe's centre) of wi; writes the longitudinal and the azimuthal density. Over n. */
__kernel void probe_densities(
    __global const float2* theta, __global const float4* to, __global float* longitudinal,
    __global float* azimuthal, const uint n, const uint lobe, const FibreParams fibre)
{
    const uint i = get_global_id(0);
    if (i >= n) return;
    const Incidence in = incidence_at(&fibre, theta[i].x, theta[i].y);
    const Longitudinal l = longitudinal_of(lobe, &fibre, &in, to[i].z);
    longitudinal[i] = longitudinal_density(&l, to[i].x, to[i].y);
    azimuthal[i] = azimuthal_density(to[i].w, azimuthal_beta(lobe, fibre.beta_n));
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
    __global const float4* numbers, const FibreParams fibre, __global const float* tables, __global const float* profiles)
{
    const uint i = get_global_id(0);
    if (i >= n) return;
    const FibreFrame frame = probe_frame(wo[i]);
    const Incidence in = incidence_at(&fibre, frame.sin_theta, frame.cos_theta);
    const float4 u = probe_numbers(seed, i, DIM_LOBE, given, numbers);
    const LobeAndOffset chosen = sample_lobe_and_offset(&fibre, tables, profiles, &in, u.xyz);
    h[i] = chosen.h;
    lobe[i] = min(chosen.lobe, (uint)FURCL_LOBES);
    wi[i] = (float4)(0.0f);
    pdf[i] = 0.0f;
    store_spectrum(weight + 3 * (size_t)i, SPECTRUM(0.0f));
    if (chosen.lobe >= FURCL_LOBES) return;
    const BcsdfAtOffset b = bcsdf_at_offset(&fibre, profiles, &in, chosen.h);
    const float3 d = lobe_sample_direction(
        chosen.lobe, &fibre, profiles, &b,
        probe_numbers(seed, i, DIM_DIRECTION, given, numbers));
    wi[i] = (float4)(frame_direction(&frame, d.x, d.y, d.z), 0.0f);
    pdf[i] = chosen.joint * lobe_terms(chosen.lobe, &fibre, profiles, &b, d.x, d.y, d.z).pdf;
    store_spectrum(weight + 3 * (size_t)i,
        (0.5f / chosen.joint) * lobe_value_over_pdf(chosen.lobe, &fibre, profiles, &b, d.x, d.z));
}
