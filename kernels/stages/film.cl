/* Last stage. Adds finished paths to the film: running mean and second moment of every pixel.

   `film` holds four spectra a pixel, next to each other: the compensated sum of radiance (sum,
   correction) and that of squared deviations (sum, correction); without FURCL_VARIANCE the first two.

   reads    state: RADIANCE
   writes   film, n_samples, nonfinite
   over     the pixels of the wave; a pixel adds its samples in their order, so the result does not
            depend on how a render is cut into waves
   next     generate of the next wave */
#include "core/paths.clh"

#define FILM_SPECTRA (FURCL_VARIANCE ? 4u : 2u)

#if FURCL_DEBUG
/* Places where a spectrum can begin. */
static inline uint film_places(Paths paths)
{
    return recorded(paths_record(paths), FURCL_CHECK_N_FILM) - (FURCL_CHANNELS - 1u);
}
#endif

/* Where a pixel's n-th spectrum is. */
static inline __global float* film_place(__global float* film, Paths paths, uint pixel, uint n)
{
    const uint place = (pixel * FILM_SPECTRA + n) * FURCL_CHANNELS;
    return film + FURCL_INDEX(paths_record(paths), place, film_places(paths));
}

/* *sum += x with the rounding error carried along (Kahan 1965). */
static inline void add_compensated(Spectrum* sum, Spectrum* correction, Spectrum x)
{
    const Spectrum y = x - *correction;
    const Spectrum total = *sum + y;
    *correction = (total - *sum) - y;
    *sum = total;
}

__kernel void add_to_film(
    __global float* state, __global float* film, __global uint* n_samples,
    __global uint* nonfinite, const Wave wave)
{
    const uint first = get_global_id(0);
    const uint n_pixels = wave.width * wave.height;
    if (first >= min(wave.n_paths, n_pixels)) return;
    const Paths paths = {state, wave.n_slots};
    const uint pixel = FURCL_INDEX(paths_record(paths), pixel_of_slot(&wave, first).index, n_pixels);
    Spectrum sum = spectrum_load(film_place(film, paths, pixel, 0u));
    Spectrum sum_correction = spectrum_load(film_place(film, paths, pixel, 1u));
#if FURCL_VARIANCE
    Spectrum squares = spectrum_load(film_place(film, paths, pixel, 2u));
    Spectrum squares_correction = spectrum_load(film_place(film, paths, pixel, 3u));
#endif
    uint samples = n_samples[pixel];
    for (uint slot = first; slot < wave.n_paths; slot += n_pixels, samples++) {
        const Spectrum radiance = path_spectrum(paths, PS_RADIANCE, slot);
        if (!spectrum_is_finite(radiance)) atomic_inc(nonfinite);
#if FURCL_VARIANCE
        /* Welford: deviation from the mean before times deviation from the mean after. */
        const float n = (float)samples;
        const Spectrum mean_before = samples > 0u ? sum * (1.0f / n) : radiance;
        const Spectrum deviation = radiance - mean_before;
        add_compensated(&squares, &squares_correction, deviation * deviation * (n / (n + 1.0f)));
#endif
        add_compensated(&sum, &sum_correction, radiance);
    }
    spectrum_store(film_place(film, paths, pixel, 0u), sum);
    spectrum_store(film_place(film, paths, pixel, 1u), sum_correction);
#if FURCL_VARIANCE
    spectrum_store(film_place(film, paths, pixel, 2u), squares);
    spectrum_store(film_place(film, paths, pixel, 3u), squares_correction);
#endif
    n_samples[pixel] = samples;
}
