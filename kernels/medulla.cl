/* Medulla profiles: multiple scattering of photons in an index-matched cylinder of radius 1.

   reads     rows (what enters), job_rows (row of each job), centres (middles of the bins)
   writes    sums [job][1 + channels][128], stats [job][2] = collisions, weight given up
   launched  over jobs, one work-item each, any work-group size
   next      the host adds the jobs up and normalises (furcl/medulla_walk.py)

   Photons never leave: each flight ends in a collision inside, weighted with the chance that it
   does, until roulette ends the walk. What leaves is scored at the collisions (medulla_score.clh),
   so every bin is filled by every photon and not by the one in 128 that leaves through it. */
#include "prelude.clh"
#include "rng.clh"
#include "hg.clh"
#include "medulla_score.clh"

#define ROW_FLOATS 10
#define DIM_WALK 0x80000000u
#define DIM_START 0xfffffff0u
#define ROULETTE_WEIGHT 0.3f
#define CERTAIN_DEPTH 4.0f

static inline Row load_row(__global const float* r)
{
    Row row = {r[0], {r[1], r[2], r[3]}, r[4], r[5], r[6], r[7], (uint)r[8], (uint)r[9]};
    return row;
}

/* Point n of a Kronecker sequence in [0, 1 - 2^-24]^4; exact in integers. */
static inline float4 kronecker(uint4 start, uint n, uint4 step)
{
    return convert_float4((start + n * step) >> 8u) * (1.0f / 16777216.0f);
}

/* Random start of a sequence: it makes each of its points uniform by itself. */
static inline uint4 sequence_start(uint seed, uint stream, uint photon, uint which)
{
    return convert_uint4(uniform4(seed, stream, photon, DIM_START + which) * 16777216.0f) << 8u;
}

/* 1 - exp(-x), x >= 0. */
static inline float collided(float x)
{
    return x < 0.05f ? x * (1.0f - x * (0.5f - x * (1.0f / 6.0f - x * (1.0f / 24.0f))))
                     : 1.0f - exp(-x);
}

/* Fraction of a chord of optical length x at which a photon that collides on it does so. */
static inline float collision_point(float x, float u)
{
    if (x < 1e-3f)
        return u * (1.0f - 0.5f * x * (1.0f - u));
    return fmin(-log1p(-u * collided(x)) / x, 1.0f);
}

/* The same with shares of the draws put near the start and near the end of the chord, at all
   scales from 1 to 1/20 of a mean free path; and the weight of the draw. A bin of directions
   almost along the axis, or beyond a dense medulla, gets its light from such places alone. */
static inline float2 scoring_point(float x, float near, float far, float u)
{
    const float scale = 0.05f / fmax(x, 1.0f);
    const float range = log((1.0f + scale) / scale);
    float y;
    if (u < near)
        y = scale * (exp(u / near * range) - 1.0f);
    else if (u < near + far)
        y = 1.0f - scale * (exp((u - near) / far * range) - 1.0f);
    else
        y = collision_point(x, (u - near - far) / (1.0f - near - far));
    y = clamp(y, 0.0f, 1.0f);
    const float law = exp(-x * y) * (x < 1e-3f ? 1.0f + 0.5f * x : x / collided(x));
    const float drawn = near / ((y + scale) * range) + far / ((1.0f - y + scale) * range) +
                        (1.0f - near - far) * law;
    return (float2)(y, law / drawn);
}

/* The point at `distance` from p along d, kept in the cylinder. */
static inline float4 advance(float4 p, float4 d, float distance)
{
    const float4 q = p + distance * d;
    const float r2 = q.x * q.x + q.y * q.y;
    const float shrink = r2 > 1.0f ? rsqrt(r2) : 1.0f;
    return (float4)(q.x * shrink, q.y * shrink, 0.0f, 0.0f);
}

static inline float distance_to_exit(float4 p, float4 d)
{
    const float a = fmax(d.x * d.x + d.y * d.y, 1e-9f);
    const float b = p.x * d.x + p.y * d.y;
    const float inside = fmax(1.0f - p.x * p.x - p.y * p.y, 0.0f);
    return fmax(sqrt(b * b + a * inside) - b, 0.0f) / a;
}

/* Score a collision; deep inside, where next to nothing gets out, seldom and weighed up. */
static inline void score(const Row* row, float g, float4 p, float4 d, float length, float weight,
                         float2 u, float dice, __global const float* centres,
                         float16 sums[PLANES][GROUPS])
{
    const float depth = row->tau * (1.0f - sqrt(p.x * p.x + p.y * p.y)) - CERTAIN_DEPTH;
    const float chance =
        depth > 0.0f ? ceil(exp(-depth) * 16777216.0f) * (1.0f / 16777216.0f) : 1.0f;
    if (dice >= chance)
        return;
    if (row->kind == AZIMUTH)
        score_azimuth(row, g, p, d, length, weight / chance, u, centres, sums);
    else
        score_longitudinal(row, g, p, d, weight / chance, u, centres + 2 * FURCL_PROFILE_PHIS,
                           sums);
}

__attribute__((vec_type_hint(float16)))
__kernel void medulla_profiles(__global const float* rows, __global const uint* job_rows,
                               __global const float* centres, float g, uint batches,
                               uint first_photon, uint max_collisions, uint seed,
                               __global float* sums_out, __global float* stats_out)
{
    const uint job = (uint)get_global_id(0);
    const uint stream = job_rows[job / batches] * batches + job % batches;
    const Row row = load_row(rows + ROW_FLOATS * job_rows[job / batches]);
    float16 sums[PLANES][GROUPS];
    for (int k = 0; k < PLANES; ++k)
        for (int i = 0; i < GROUPS; ++i)
            sums[k][i] = (float16)(0.0f);

    const uint4 start_first = sequence_start(seed, stream, first_photon, 0u);
    const uint4 start_second = sequence_start(seed, stream, first_photon, 1u);
    const uint4 start_later = sequence_start(seed, stream, first_photon, 2u);
    /* 2^32 over powers of the real root of x^9 = x + 1, and of x^5 = x + 1. */
    const uint4 step_first = (uint4)(3958238937u, 3647910313u, 3361911661u, 3098335501u);
    const uint4 step_second = (uint4)(2855423889u, 2631556713u, 2425240877u, 2235100341u);
    const uint4 step_later = (uint4)(3679390609u, 3152041523u, 2700274805u, 2313257605u);
    const float widest = 2.0f * row.tau / row.cos_in;

    uint collisions = 0u, scored = 0u;
    float given_up = 0.0f;
    for (uint i = 0u; i < row.photons; ++i) {
        const float4 v = kronecker(start_first, i, step_first);
        const float4 w = kronecker(start_second, i, step_second);
        float h = row.offset, half_chord = row.half_chord;
        if (row.kind == LONGITUDINAL) {
            h = 2.0f * v.x - 1.0f;
            half_chord = sqrt((1.0f - h) * (1.0f + h));
        }
        float4 p = (float4)(half_chord, -h, 0.0f, 0.0f);
        float4 d = (float4)(-row.cos_in, 0.0f, -row.sin_in, 0.0f);
        float chord = 2.0f * half_chord / row.cos_in;
        float x = row.tau * chord;

        /* Of an AZIMUTH row only photons that collide count; over h they count by their chance. */
        float weight = 1.0f;
        if (row.kind == LONGITUDINAL)
            weight = half_chord * (x > 0.05f ? collided(x) / x : 1.0f - 0.5f * x) /
                     (widest > 0.05f ? collided(widest) / widest : 1.0f - 0.5f * widest);
        const float2 place = scoring_point(x, 0.2f, 0.2f, v.y);
        score(&row, g, advance(p, d, place.x * chord), d, place.x * chord, weight * place.y, v.zw,
              0.0f, centres, sums);
        float length = collision_point(x, w.x) * chord;
        p = advance(p, d, length);
        d = hg_turn(d, hg_sample(g, w.y), TWO_PI * w.z);

        uint n = 1u;
        for (;;) {
            const float4 u = uniform4(seed, stream, first_photon + i, DIM_WALK + n);
            const float4 v = kronecker(start_later, scored++, step_later);
            chord = distance_to_exit(p, d);
            x = row.tau * chord;
            const float met = collided(x);
            if (row.kind == LONGITUDINAL) {
                const float2 place = scoring_point(x, 0.0f, 0.3f, v.z);
                score(&row, g, advance(p, d, place.x * chord), d, 0.0f, weight * met * place.y,
                      v.xy, v.w, centres, sums);
            }
            if (weight * met >= ROULETTE_WEIGHT) {
                weight *= met;
            } else {
                const float survive = met * fmin(weight / ROULETTE_WEIGHT, 1.0f);
                if (u.w >= survive)
                    break;
                weight *= met / survive;
            }
            const float flight = collision_point(x, u.z) * chord;
            p = advance(p, d, flight);
            length += flight;
            if (row.kind == AZIMUTH)
                score(&row, g, p, d, length, weight, v.xy, v.w, centres, sums);
            if (++n == max_collisions) {
                given_up += weight;
                break;
            }
            d = hg_turn(d, hg_sample(g, u.x), TWO_PI * u.y);
        }
        collisions += n;
    }
    for (int k = 0; k < PLANES; ++k)
        for (int i = 0; i < GROUPS; ++i)
            vstore16(sums[k][i], (job * PLANES + k) * GROUPS + i, sums_out);
    stats_out[2u * job] = (float)collisions;
    stats_out[2u * job + 1u] = given_up;
}
