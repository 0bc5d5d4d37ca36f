/* Stage 4 of fibres. Chooses the lobe and the offset h for every path that met a fibre.

   reads    state: DIR, HIT_*; vertices, material, absorption (where strands or points have values); where h
            is that of the hit, or near it, ORIGIN too, and the camera
   writes   state: LOBE, OFFSET_H, JOINT; lobe_counts (with FURCL_STATISTICS)
   over     the hit queue of its material, of number `queue`, FURCL_PATHS_PER_ITEM a work-item
   next     shade */
#include "fibre/sampler.clh"
#include "geometry/fibre_hits.clh"
#if FURCL_ABSORPTION >= FURCL_ABSORPTION_STRAND
#include "fibre/absorption.clh"
#endif
#if FURCL_MODE != FURCL_MODE_FAR
#include "fibre/hit_offsets.clh"
#endif

__kernel void sample_lobe_h(
    __global float* state, __global const uint* hit_queues, __global const uint* counts,
    const Wave wave, const uint depth, const uint queue, __global const StoredVertex* vertices,
    __global const float* material, __global uint* lobe_counts
#if FURCL_ABSORPTION >= FURCL_ABSORPTION_STRAND
    , __global const uint* absorption, __global const uint* strands
#endif
#if FURCL_MODE == FURCL_MODE_MULTISCALE
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
#if FURCL_STATISTICS
    uint chosen_times[FURCL_LOBES];
    for (uint p = 0; p < FURCL_LOBES; p++) chosen_times[p] = 0u;
#endif
    fetch_vertices_early(paths, hit_queue, entries, vertices);
    for (uint first = 0; first < FURCL_PATHS_PER_ITEM && first < entries.n; first += FURCL_LANES) {
        const FibreHits hits = fibre_hits_from(first, paths, hit_queue, entries, &wave,
                                               bounce_dimension(depth, DIM_LOBE), vertices);
        for (uint k = 0; k < lanes_in_use(first, entries); k++) {
            const uint slot = hits.slot[k];
#if FURCL_ABSORPTION >= FURCL_ABSORPTION_STRAND
            take_absorption(&fibre, values, paths, slot);
#endif
            const Incidence in = incidence_at(
                &fibre, lane(&hits.frames.sin_theta, k), lane(&hits.frames.cos_theta, k));
#if FURCL_MODE != FURCL_MODE_FAR
            const FibreFrame frame = frame_of_lane(&hits.frames, k);
            const Offsets within = offsets_of_hit(paths, slot, depth, &wave, vertices, &frame
#if FURCL_MODE == FURCL_MODE_MULTISCALE
                , &camera, uint_lane(&hits.pixel, k), uint_lane(&hits.sample, k)
#endif
                );
            const LobeAndOffset chosen = sample_within(&fibre, &in, within, lane4(&hits.xi, k).xyz);
#else
            const LobeAndOffset chosen = sample_lobe_and_offset(&fibre, &in, lane4(&hits.xi, k).xyz);
#endif
            set_path_uint(paths, PS_LOBE, slot, chosen.lobe);
            set_path_float(paths, PS_OFFSET_H, slot, chosen.h);
            set_path_float(paths, PS_JOINT, slot, chosen.joint);
#if FURCL_STATISTICS
            if (chosen.lobe < FURCL_LOBES) chosen_times[chosen.lobe]++;
#endif
        }
    }
#if FURCL_STATISTICS
    for (uint p = 0; p < FURCL_LOBES; p++)
        if (chosen_times[p] > 0u) atomic_add(lobe_counts + p, chosen_times[p]);
#endif
}
