/* Medulla profiles: multiple scattering of photons in an index-matched cylinder of radius 1.

   medulla_azimuth
   reads     rows (what enters), job_rows (row of each job), centres (middles of the bins)
   writes    sums [job][1 + channels][128], stats [job][2] = collisions, weight given up
   launched  over jobs, one work-item each, any work-group size

   medulla_longitudinal
   reads     rows (tau), incidence (cos and sin of theta_i), centres
   writes    sums [job][16][2 * 64], stats as above
   launched  over batches, one work-item each, any work-group size

   next      the host adds the jobs up and normalises (furcl/fibre/double_cylinder/medulla_walk.py) */
#include "core/prelude.clh"
#include "core/rng.clh"
#include "fibre/double_cylinder/hg.clh"
#include "fibre/double_cylinder/medulla_score.clh"
#include "fibre/double_cylinder/medulla_walk.clh"

#define ROW_FLOATS 8
#define LONGITUDINAL_STREAM 0x40000000u

static inline Row load_row(__global const float* r)
{
    Row row = {r[0], {r[1], r[2], r[3]}, r[4], r[5], (uint)r[6], (uint)r[7]};
    return row;
}

/* Rows of fixed h, light at theta = 0. Every photon counts once that collides at all. */
__attribute__((vec_type_hint(float16)))
__kernel void medulla_azimuth(__global const float* rows, __global const uint* job_rows,
                              __global const float* centres, float g, uint batches,
                              uint first_photon, uint max_collisions, uint seed,
                              __global float* sums_out, __global float* stats_out)
{
    const uint job = (uint)get_global_id(0);
    const uint index = job_rows[job / batches];
    const Row row = load_row(rows + ROW_FLOATS * index);
    Randomness random = start_sequences(seed, index * batches + job % batches, first_photon);
    float16 sums[PLANES][GROUPS];
    for (int k = 0; k < PLANES; ++k)
        for (int i = 0; i < GROUPS; ++i)
            sums[k][i] = (float16)(0.0f);

    const float4 entry = (float4)(row.half_chord, -row.offset, 0.0f, 0.0f);
    const float4 inward = (float4)(-1.0f, 0.0f, 0.0f, 0.0f);
    const float chord = 2.0f * row.half_chord;
    const float x = row.tau * chord;
    uint collisions = 0u;
    float given_up = 0.0f;
    for (uint i = 0u; i < row.photons; ++i) {
        const float4 v = first_numbers(&random, i);
        const float4 w = second_numbers(&random, i);
        const float2 place = scoring_point(x, 0.2f, 0.2f, v.x);
        score(&row, g, advance(entry, inward, place.x * chord), inward, place.x * chord, place.y,
              v.yz, 0.0f, centres, sums);
        const float length = collision_point(x, v.w) * chord;
        const float4 p = advance(entry, inward, length);
        const float4 d = hg_turn(inward, hg_sample(g, w.x), TWO_PI * w.y);
        collisions += walk(&row, g, max_collisions, first_photon + i, p, d, length, &random,
                           centres, sums, &given_up);
    }
    for (int k = 0; k < PLANES; ++k)
        for (int i = 0; i < GROUPS; ++i)
            vstore16(sums[k][i], (job * PLANES + k) * GROUPS + i, sums_out);
    stats_out[2u * job] = (float)collisions;
    stats_out[2u * job + 1u] = given_up;
}

/* 1 - exp(-x) for 16 x >= 0. */
static inline float16 collided_16(float16 x)
{
    return select(1.0f - exp(-x),
                  x * (1.0f - x * (0.5f - x * (1.0f / 6.0f - x * (1.0f / 24.0f)))), x < 0.05f);
}

/* An offset h: half of the draws evenly, half with 1 - |h| at all scales down to 1e-4; the chord
   at the rim alone is short enough for light near the axis. Returns h, sqrt(1 - h^2), weight. */
static inline float4 draw_offset(float xi)
{
    const float range = log((1.0f + 1e-4f) / 1e-4f);
    const float side = xi < 0.5f ? -1.0f : 1.0f;
    const float v = xi < 0.5f ? 2.0f * xi : 2.0f * xi - 1.0f;
    const float rim = fmin(v < 0.5f ? 2.0f * v : 1e-4f * (exp((2.0f * v - 1.0f) * range) - 1.0f),
                           1.0f);
    const float density = 0.5f + 0.5f / ((rim + 1e-4f) * range);
    return (float4)(side * (1.0f - rim), sqrt(rim * (2.0f - rim)), 1.0f / density, 0.0f);
}

/* All 16 rows over theta_i at once, each having its turn within FURCL_MEDULLA_CYCLE photons, light
   uniform over h; one job a batch. First collisions are
   scored row by row. From then on a walk belongs to every row from which it could have started
   (balance heuristic over the rows); the row of light along the axis, which collides at the rim,
   shares next to nothing and has more turns. Rows are scaled by 1 / (chance to collide at h = 0). */
__attribute__((vec_type_hint(float16)))
__kernel void medulla_longitudinal(__global const float* rows, __global const float* incidence,
                                   __global const float* centres, float g, uint photons,
                                   uint first_photon, uint max_collisions, uint seed,
                                   __global float* sums_out, __global float* stats_out)
{
    const uint job = (uint)get_global_id(0);
    const Row row = load_row(rows);
    Randomness random = start_sequences(seed, LONGITUDINAL_STREAM + job, first_photon);
    float16 totals[FURCL_PROFILE_THETAS][GROUPS];
    for (int k = 0; k < FURCL_PROFILE_THETAS; ++k)
        for (int i = 0; i < GROUPS; ++i)
            totals[k][i] = (float16)(0.0f);
    const float16 cos_in = vload16(0, incidence), sin_in = vload16(1, incidence);
    const float16 rate = row.tau / cos_in;
    float copies[FURCL_PROFILE_THETAS];
    for (int k = 0; k < FURCL_PROFILE_THETAS; ++k)
        copies[k] = k < FURCL_PROFILE_THETAS - 1 ? 1.0f : FURCL_MEDULLA_CYCLE - FURCL_PROFILE_THETAS + 1.0f;
    const float16 scale = 1.0f / collided_16(2.0f * rate);

    uint collisions = 0u;
    float given_up = 0.0f;
    for (uint i = 0u; i < photons; ++i) {
        const uint own = min(i % FURCL_MEDULLA_CYCLE, FURCL_PROFILE_THETAS - 1u);
        const float own_cos = incidence[own];
        const float4 inward = (float4)(-own_cos, 0.0f, -incidence[FURCL_PROFILE_THETAS + own], 0.0f);
        const float4 v = first_numbers(&random, i);
        const float4 w = second_numbers(&random, i);
        float16 sums[PLANES][GROUPS];
        for (int k = 0; k < GROUPS; ++k)
            sums[0][k] = (float16)(0.0f);
        {
            const float4 h = draw_offset(v.x);
            const float chord = 2.0f * h.y / own_cos;
            const float x = row.tau * chord;
            const float weight = FURCL_MEDULLA_CYCLE / copies[own] * h.z * collided(x) /
                                 collided(2.0f * row.tau / own_cos);
            const float2 place = scoring_point(x, 0.2f, 0.2f, v.y);
            const float4 entry = (float4)(h.y, -h.x, 0.0f, 0.0f);
            score(&row, g, advance(entry, inward, place.x * chord), inward, 0.0f,
                  weight * place.y, v.zw, 0.0f, centres, sums);
        }
        for (int k = 0; k < GROUPS; ++k) {
            totals[own][k] += sums[0][k];
            sums[0][k] = (float16)(0.0f);
        }
        const float h = 2.0f * w.x - 1.0f;
        const float half_chord = sqrt((1.0f - h) * (1.0f + h));
        const float across =
            2.0f * half_chord * collision_point(2.0f * half_chord * row.tau / own_cos, w.y);
        const float4 p = (float4)(half_chord - across, -h, 0.0f, 0.0f);
        const float4 d = hg_turn(inward, hg_sample(g, w.z), TWO_PI * w.w);
        collisions += walk(&row, g, max_collisions, first_photon + i, p, d, 0.0f, &random,
                           centres, sums, &given_up);

        const float16 met = collided_16(2.0f * half_chord * rate);
        const float16 base = fmax(1.0f + g * g + 2.0f * g * (cos_in * d.x + sin_in * d.z),
                                  (1.0f - fabs(g)) * (1.0f - fabs(g)));
        const float16 density = exp(-rate * across) * rate / (base * sqrt(base));
        const float16 drawn = density / met * vload16(0, copies);
        float share[FURCL_PROFILE_THETAS];
        vstore16(density * scale, 0, share);
        const float8 eight = drawn.lo + drawn.hi;
        const float4 four = eight.lo + eight.hi;
        const float mixture = (four.x + four.y + four.z + four.w) * (1.0f / FURCL_MEDULLA_CYCLE);
        for (int k = 0; k < FURCL_PROFILE_THETAS; ++k)
            for (int j = 0; j < GROUPS; ++j)
                totals[k][j] += share[k] / mixture * sums[0][j];
    }
    for (int k = 0; k < FURCL_PROFILE_THETAS; ++k)
        for (int i = 0; i < GROUPS; ++i)
            vstore16(totals[k][i], (job * FURCL_PROFILE_THETAS + k) * GROUPS + i, sums_out);
    stats_out[2u * job] = (float)collisions;
    stats_out[2u * job + 1u] = given_up;
}
