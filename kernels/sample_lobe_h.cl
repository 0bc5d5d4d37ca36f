/* Stage 3 of 5. Chooses the lobe and the offset h for every path that met a fibre.

   reads    state: DIR, HIT_SEGMENT; vertices, tables, profiles
   writes   state: LOBE, OFFSET_H, JOINT; lobe_counts (with FURCL_STATISTICS)
   over     the hit queue, FURCL_PATHS_PER_ITEM a work-item
   next     shade */
#include "frame.clh"
#include "tables.clh"
#include "vertices.clh"
#include "camera.clh"
#include "queue.clh"

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
    FOR_QUEUE_ENTRIES(i, n_hits) {
        const uint slot = FURCL_AT(hit_queue, i, n_slots);
        const uint segment = PS_U(HIT_SEGMENT, slot);
#if FURCL_BODY
        if (segment == FURCL_BODY_SEGMENT) continue;
#endif
        const float3 along = VERTEX(vertices, FURCL_INDEX(segment + 1, FURCL_N_VERTICES)).xyz -
            VERTEX(vertices, FURCL_INDEX(segment, FURCL_N_VERTICES)).xyz;
        const FibreFrame frame = fibre_frame(along, -PS_LOAD3(DIR, slot));
        const Incidence in = incidence_at(&fibre, frame.sin_theta, frame.cos_theta);
        const PixelSample p = pixel_of_slot(&wave, slot);
        const float4 u = uniform4(wave.seed, p.index, p.sample, bounce_dimension(depth, DIM_LOBE));
        const LobeAndOffset chosen = sample_lobe_and_offset(&fibre, tables, profiles, &in, u.xyz);
        PS_U(LOBE, slot) = chosen.lobe;
        PS_F(OFFSET_H, slot) = chosen.h;
        PS_F(JOINT, slot) = chosen.joint;
#if FURCL_STATISTICS
        if (chosen.lobe < FURCL_LOBES) chosen_times[chosen.lobe]++;
#endif
    }
#if FURCL_STATISTICS
    for (uint p = 0; p < FURCL_LOBES; p++)
        if (chosen_times[p] > 0u) atomic_add(lobe_counts + p, chosen_times[p]);
#endif
}
