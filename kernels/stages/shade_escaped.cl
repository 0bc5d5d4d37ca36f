/* Stage 3. Light found by rays that met nothing.

   reads    state: ORIGIN, DIR, THROUGHPUT, DIR_PDF; light
   writes   state: RADIANCE; the paths end here
   over     the miss queue, FURCL_PATHS_PER_ITEM a work-item
   next     film */
#include "core/paths.clh"
#include <light>
#if FURCL_LEARNING
#include <learning>
#endif

__kernel void shade_escaped(
    __global float* state, __global const uint* miss_queue, __global const uint* counts,
    const Wave wave, __global const float* light
#if FURCL_LEARNING || FURCL_TRANSPARENT
    , const uint depth
#endif
#if FURCL_LEARNING
    , __global uint* records
#endif
    )
{
    const uint n_misses = counts[FURCL_COUNT_MISSES];
    const Paths paths = {state, wave.n_slots};
    for (uint k = 0; k < FURCL_PATHS_PER_ITEM && queue_entry(k) < n_misses; k++) {
        const uint slot = queued_slot(paths, miss_queue, queue_entry(k));
        const float3 direction = path_float3(paths, PS_DIR, slot);
        Spectrum radiance = spectrum_from3(light_radiance(light, direction));
#if FURCL_LIGHT_SAMPLING
        /* Balance heuristic against the light sample of the vertex before; camera rays have none. */
        const float pdf = path_float(paths, PS_DIR_PDF, slot);
        if (pdf > 0.0f)
            radiance *= pdf / (pdf + light_density(light, path_float3(paths, PS_ORIGIN, slot), direction));
#endif
#if FURCL_LEARNING
        if (wave.recording) {
            const Learned learned = {0, records, wave.n_slots};
            record_arrival(&learned, depth, slot, spectrum_mean(path_spectrum(paths, PS_RADIANCE, slot)), true);
        }
#endif
#if FURCL_TRANSPARENT
        if (depth == 0u) continue;
#endif
        set_path_spectrum(paths, PS_RADIANCE, slot,
            path_spectrum(paths, PS_RADIANCE, slot) + path_spectrum(paths, PS_THROUGHPUT, slot) * radiance);
    }
}
