/* Stage 5 of 5. Adds finished paths to the film: running mean and second moment of every pixel.

   `film` holds planes of n_pixels floats: for each channel the compensated sum of radiance (sum,
   correction) and, with FURCL_VARIANCE, the compensated sum of squared deviations (sum, correction).

   reads    state: RADIANCE
   writes   film, n_samples, nonfinite
   over     the pixels of the wave; a pixel adds its samples in their order, so the result does not
            depend on how a render is cut into waves
   next     generate of the next wave */
#include "camera.clh"
#include "spectrum.clh"

/* A pixel of a plane that another of the same size follows; checked in debug builds. */
#define FILM_PLACE(plane) \
    (film + FURCL_INDEX((plane) * n_pixels + pixel, FURCL_N_FILM - n_pixels))

/* sum += x with the rounding error carried along (Kahan 1965). */
static inline void add_compensated(__global float* sum, uint n_pixels, float x)
{
    __global float* correction = sum + n_pixels;
    const float y = x - *correction;
    const float total = *sum + y;
    *correction = (total - *sum) - y;
    *sum = total;
}

__kernel void add_to_film(
    __global const float* state, __global float* film, __global uint* n_samples,
    __global uint* nonfinite, const Wave wave)
{
    const uint first = get_global_id(0);
    const uint n_pixels = wave.width * wave.height;
    if (first >= min(wave.n_paths, n_pixels)) return;
    const uint n_slots = wave.n_slots;
    const uint pixel = FURCL_INDEX(pixel_of_slot(&wave, first).index, n_pixels);
    for (uint slot = first; slot < wave.n_paths; slot += n_pixels) {
        const Spectrum radiance = PS_LOAD_SPECTRUM(RADIANCE, slot);
        if (!spectrum_is_finite(radiance)) atomic_inc(nonfinite);
#if FURCL_CHANNELS == 1
        const float channel[1] = {radiance};
#else
        const float channel[3] = {radiance.x, radiance.y, radiance.z};
#endif
        const float n = (float)n_samples[pixel];
#if FURCL_VARIANCE
        const float inv_n = 1.0f / n, spread = n / (n + 1.0f);
#endif
        for (uint c = 0; c < FURCL_CHANNELS; c++) {
            const size_t plane = c * (FURCL_VARIANCE ? 4u : 2u);
#if FURCL_VARIANCE
            /* Welford: deviation from the mean before times deviation from the mean after. */
            const float sum = *FILM_PLACE(plane);
            const float mean_before = n > 0.0f ? sum * inv_n : channel[c];
            const float deviation = channel[c] - mean_before;
            add_compensated(FILM_PLACE(plane + 2u), n_pixels, deviation * deviation * spread);
#endif
            add_compensated(FILM_PLACE(plane), n_pixels, channel[c]);
        }
        n_samples[pixel] += 1u;
    }
}
