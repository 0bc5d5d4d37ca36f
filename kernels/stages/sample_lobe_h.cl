/* Stage 3 of 5. Chooses the lobe and the offset h for every path that met a fibre.

   reads    state: DIR, HIT_SEGMENT; vertices, tables, profiles
   writes   state: LOBE, OFFSET_H, JOINT; lobe_counts (with FURCL_STATISTICS)
   over     the hit queue, FURCL_PATHS_PER_ITEM a work-item
   next     shade */
#include "core/hits.clh"
#include "fibre/attenuation_tables.clh"

__kernel void sample_lobe_h(
    __global float* state, __global const uint* hit_queue, __global const uint* counts,
    const Wave wave, const uint depth, const FibreParams fibre, __global const StoredVertex* vertices,
    __global const float* tables, __global const float* profiles, __global uint* lobe_counts)
{
    const uint n_hits = counts[FURCL_COUNT_HITS];
    const uint n_slots = wave.n_slots;
#if FURCL_STATISTICS
    uint chosen_times[FURCL_LOBES];
    for (uint p = 0; p < FURCL_LOBES; p++) chosen_times[p] = 0u;
#endif
    FETCH_VERTICES_EARLY(hit_queue, n_hits, vertices);
    FOR_GROUPS_OF_HITS(first, n_hits) {
        const Hits hits = hits_from(first, state, hit_queue, n_hits, &wave,
                                    bounce_dimension(depth, DIM_LOBE), vertices);
        FOR_HITS(k, first, n_hits) {
            const uint slot = hits.slot[k];
#if FURCL_BODY
            if (PS_U(HIT_SEGMENT, slot) == FURCL_BODY_SEGMENT) continue;
#endif
            const Incidence in =
                incidence_at(&fibre, LANE(hits.frames.sin_theta, k), LANE(hits.frames.cos_theta, k));
            const LobeAndOffset chosen =
                sample_lobe_and_offset(&fibre, tables, profiles, &in, LANES4_AT(hits.u, k).xyz);
            PS_U(LOBE, slot) = chosen.lobe;
            PS_F(OFFSET_H, slot) = chosen.h;
            PS_F(JOINT, slot) = chosen.joint;
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
