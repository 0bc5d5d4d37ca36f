/* Light that the medulla has scattered, as it leaves the whole fibre (docs/model.md, Simulated scattering).

   reads     rows [SIMULATED_ROWS][4]: sine and cosine of the inclination inside, offset over the medulla's
             radius, its cosine; fibre: eta, kappa, 1 - kappa, layers, g, tau, then absorption of the
             medulla and of the cortex, WALK_CHANNELS each
   writes    sums [row][batch][channel][SIMULATED_PHIS][SIMULATED_SINES], energy;
             stats [row][batch][2] = collisions, photons given up
   launched  over rows x batches, one work-item each, any work-group size
   next      the host adds the batches up (furcl/fibre/double_cylinder/whole_fibre_walk.py) */
#include "core/prelude.clh"
#include "fibre/double_cylinder/whole_walk.clh"

/* Every photon scatters on its first crossing. */
__attribute__((vec_type_hint(float16)))
__kernel void scattered_light(__global const float* rows, __global const float* fibre, uint batches,
                              uint photons, uint first_photon, uint max_collisions, uint seed,
                              __global float* sums_out, __global float* stats_out)
{
    const uint job = (uint)get_global_id(0);
    __global const float* row = rows + 4u * (job / batches);
    WalkedFibre f = {fibre[0], fibre[1], fibre[2], fibre[3], fibre[4], fibre[5], {0.0f}, {0.0f}};
    for (int c = 0; c < WALK_CHANNELS; ++c) {
        f.medulla[c] = fibre[6 + c];
        f.cortex[c] = fibre[6 + WALK_CHANNELS + c];
    }
    Randomness random = start_sequences(seed, job, first_photon);
    __global float* sums = sums_out + (size_t)job * WALK_CHANNELS * CELLS;
    for (uint i = 0u; i < WALK_CHANNELS * CELLS; ++i) sums[i] = 0.0f;

    const float4 entry = (float4)(row[3], -row[2], 0.0f, 0.0f);
    const float4 inward = (float4)(-row[1], 0.0f, -row[0], 0.0f);
    const float chord = 2.0f * row[3] / row[1];
    uint collisions = 0u;
    float given_up = 0.0f;
    for (uint i = 0u; i < photons; ++i) {
        const float length = chord * collision_point(f.tau * chord, first_numbers(&random, i).x);
        float4 p = entry + length * inward;
        p.z = 0.0f;
        float weight[WALK_CHANNELS];
        for (int c = 0; c < WALK_CHANNELS; ++c) weight[c] = exp(-f.medulla[c] * length);
        collisions += walk_out(&f, max_collisions, first_photon + i, p, inward, weight, &random, sums,
                               &given_up);
    }
    stats_out[2u * job] = (float)collisions;
    stats_out[2u * job + 1u] = given_up;
}
