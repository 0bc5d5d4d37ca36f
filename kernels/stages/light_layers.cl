/* Stage before the film, of films with layers of scattered light.

   `sums` holds FURCL_LIGHT_SUMS a pixel (furcl/rendering/layers.py).

   reads    state: RADIANCE, FIRST, ALBEDO, DIRECT, FIRST_LIGHT, FIRST_SEEN; plan (with FURCL_PLANNED)
   writes   sums
   over     the pixels of the wave, as add_to_film
   next     add_to_film */
#include "core/paths.clh"
#include <layers>

/* The light of a path by the lobe of its first scattering: that of the first light sample, which all lobes
   share, and the rest, which is the chosen lobe's. Surfaces are the last of them. */
#if FURCL_LAYER_LOBES
static inline void light_of_lobes(Paths paths, uint slot, uint first, Spectrum radiance, float* values)
{
    Spectrum rest = radiance;
    for (uint p = 0u; p <= FURCL_LOBE_LAYERS; p++) put_spectrum(values + FURCL_CHANNELS * p, spectrum(0.0f));
#if FURCL_LIGHT_SAMPLING
    if (path_uint(paths, PS_FIRST_SEEN, slot) != 0u && first < FURCL_LOBE_LAYERS) {
        for (uint p = 0u; p < FURCL_LOBE_LAYERS; p++) {
            const Spectrum light = path_spectrum(paths, PS_FIRST_LIGHT_0 + FURCL_CHANNELS * p, slot);
            put_spectrum(values + FURCL_CHANNELS * p, light);
            rest -= light;
        }
        rest = fmax(rest, spectrum(0.0f));  /* nothing but the rounding of the sum */
    }
#endif
    float own[FURCL_CHANNELS];
    put_spectrum(own, rest);
    for (uint c = 0u; c < FURCL_CHANNELS; c++) values[FURCL_CHANNELS * first + c] += own[c];
}
#endif

__kernel void add_light_layers(
    __global float* state, __global float2* all_sums, const Wave wave
#if FURCL_PLANNED
    , __global const uint* plan
#endif
    )
{
    const Paths paths = {state, wave.n_slots};
    const PixelSlots slots = slots_of_pixel(paths, &wave,
#if FURCL_PLANNED
        plan,
#endif
        get_global_id(0));
    if (slots.first >= slots.end) return;
    __global float2* sums = all_sums + (size_t)film_pixel(&wave, slots.pixel) * FURCL_LIGHT_SUMS;
    for (uint slot = slots.first; slot < slots.end; slot += slots.step) {
        const uint first = path_uint(paths, PS_FIRST, slot);
        if (first == FURCL_NOTHING_MET) continue;
        const Spectrum radiance = path_spectrum(paths, PS_RADIANCE, slot);
        float values[FURCL_LIGHT_SUMS];
#if FURCL_LAYER_ALBEDO
        put_spectrum(values + FURCL_SUM_ALBEDO, path_spectrum(paths, PS_ALBEDO, slot));
#endif
#if FURCL_SPLIT_DIRECT
        const float taken = path_float(paths, PS_DIRECT, slot);
        const Spectrum direct = taken < 0.0f ? radiance : path_spectrum(paths, PS_DIRECT, slot);
#endif
#if FURCL_LAYER_DIRECT
        put_spectrum(values + FURCL_SUM_DIRECT, direct);
#endif
#if FURCL_LAYER_INDIRECT
        put_spectrum(values + FURCL_SUM_INDIRECT, radiance - direct);
#endif
#if FURCL_LAYER_LOBES
        light_of_lobes(paths, slot, first, radiance, values + FURCL_SUM_LOBES);
#endif
        add_to_sums(sums, values, FURCL_LIGHT_SUMS);
    }
}
