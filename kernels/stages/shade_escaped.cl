/* Stage 3. Light found by rays that met nothing or a lamp.

   reads    state: ORIGIN, DIR, THROUGHPUT, DIR_PDF, of lamps HIT_*; light
   writes   state: RADIANCE; the paths end here
   over     the miss queue, FURCL_PATHS_PER_ITEM a work-item
   next     film */
#include "core/paths.clh"
#include "light/lights.clh"
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
    const Entries entries = entries_of_item(counts[FURCL_COUNT_MISSES]);
    const Paths paths = {state, wave.n_slots};
    for (uint k = 0; k < FURCL_PATHS_PER_ITEM && k < entries.n; k++) {
        const uint slot = queued_slot(paths, miss_queue, entries.begin + k);
        const float3 direction = path_float3(paths, PS_DIR, slot);
        const float3 origin = path_float3(paths, PS_ORIGIN, slot);
        float pdf = 0.0f;
#if FURCL_LIGHT_SAMPLING
        pdf = path_float(paths, PS_DIR_PDF, slot);
#endif
        float3 found;
#if FURCL_AREA_LAMPS
        if (path_uint(paths, PS_HIT_SEGMENT, slot) == FURCL_LAMP_HIT)
            found = radiance_of_lamp(light, (uint)path_float(paths, PS_HIT_U, slot),
                                     path_float(paths, PS_HIT_T, slot), origin, direction, pdf);
        else
#endif
            found = radiance_from_infinity(light, origin, direction, pdf);
        const Spectrum radiance = spectrum_from3(found);
#if FURCL_LEARNING
        if (wave.recording) {
            const Learned learned = {0, records, wave.n_slots};
            record_arrival(&learned, depth, slot, spectrum_mean(path_spectrum(paths, PS_RADIANCE, slot)), true);
        }
#endif
#if FURCL_TRANSPARENT
        bool behind = depth == 0u;
#if FURCL_AREA_LAMPS
        behind = behind && path_uint(paths, PS_HIT_SEGMENT, slot) != FURCL_LAMP_HIT;
#endif
        if (behind) continue;
#endif
        set_path_spectrum(paths, PS_RADIANCE, slot,
            path_spectrum(paths, PS_RADIANCE, slot) + path_spectrum(paths, PS_THROUGHPUT, slot) * radiance);
    }
}
