/* Attenuation tables (docs/model.md, Sampling), filled with the same device functions that render.

   reads    rows: sine and cosine of the theta of each row; material
   writes   bins [n_rows][FURCL_LOBES][TABLE_BINS] of float2, for the channels' mean of A_p(h): its mean
            over the bin, by the trapezoidal rule: the ends of the bin count, so that a lobe that ends
            just inside it is seen; and its largest value there
   over     n_rows x TABLE_BINS
   next     furcl/fibre/attenuation.py turns the bins into CDFs */
#include <fibre>

#define TABLE_STEPS 16u
#define EDGE_PLACES 12u
#define NARROW_PLACES 20u

/* Offsets lie even in a bin, in the last one dense at the rim: near |h| = 1 light goes over from the
   other lobes to R within a part of the bin that shrinks as eta and the layers do. */
static inline float place_in_bin(uint bin, uint k)
{
    const float left = 1.0f - (float)k * (1.0f / TABLE_STEPS);
    return 1.0f - (bin == FURCL_TABLE_BINS - 1u ? square(square(left)) : left);
}

/* Offsets beside the edge of the attenuation (the first EDGE_PLACES) and below the rim, where a lobe can
   be alive in far less than a step. */
static inline float narrow_place(float edge, uint k)
{
    const float away = exp2(-23.0f + 3.0f * (float)(k >> 1));
    if (k < EDGE_PLACES) return edge * (1.0f + (k & 1u ? away : -away));
    return 1.0f - exp2(-24.0f + 2.0f * (float)(k - EDGE_PLACES));
}

__kernel void attenuation_bins(
    __global float2* bins, __global const float2* rows, const uint n_rows,
    __global const float* material)
{
    const uint i = get_global_id(0);
    if (i >= n_rows * FURCL_TABLE_BINS) return;
    const Fibre fibre = fibre_of(material);
    const uint row = i / FURCL_TABLE_BINS, bin = i % FURCL_TABLE_BINS;
    const Incidence in = incidence_at(&fibre, rows[row].x, rows[row].y);
    /* Between this row and the next the edge sweeps over bins; beside it, energies are alike in all. */
    const float edge = attenuation_edge(&fibre, rows[row].y);
    const float edge_after = attenuation_edge(&fibre, rows[min(row + 1u, n_rows - 1u)].y);
    const bool swept = (float)(bin + 1u) >= 0.9999f * edge * FURCL_TABLE_BINS &&
        (float)bin <= 1.0001f * edge_after * FURCL_TABLE_BINS;
    float sum[FURCL_LOBES], peak[FURCL_LOBES];
    for (uint p = 0; p < FURCL_LOBES; p++) sum[p] = peak[p] = 0.0f;
    /* First the even places, then the narrow ones, which count for the peak alone. */
    for (uint k = 0; k <= TABLE_STEPS + NARROW_PLACES; k++) {
        const float inside = place_in_bin(bin, min(k, TABLE_STEPS));
        float share = 0.0f;
        if (k <= TABLE_STEPS) {
            share = 0.5f * (place_in_bin(bin, min(k + 1u, TABLE_STEPS)) -
                            place_in_bin(bin, max(k, 1u) - 1u));
        }
        float h = ((float)bin + inside) * (1.0f / FURCL_TABLE_BINS);
        if (k > TABLE_STEPS) {
            const uint narrow = k - TABLE_STEPS - 1u;
            const float place = narrow_place(edge, narrow);
            const bool here = narrow < EDGE_PLACES ? swept : (uint)(place * FURCL_TABLE_BINS) == bin;
            if (here && place <= 1.0f) h = place;
        }
        const BcsdfAtOffset b = bcsdf_at_offset(&fibre, &in, h);
        for (uint p = 0; p < FURCL_LOBES; p++) {
            if (!lobe_exists(p)) continue;
            const float energy = spectrum_mean(lobe_attenuation(p, &fibre, &b));
            sum[p] += share * energy;
            peak[p] = energy > peak[p] ? energy : peak[p];
        }
    }
    for (uint p = 0; p < FURCL_LOBES; p++)
        bins[(row * FURCL_LOBES + p) * FURCL_TABLE_BINS + bin] = (float2)(sum[p], peak[p]);
}
