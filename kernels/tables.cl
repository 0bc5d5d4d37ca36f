/* Attenuation tables (SPEC 4.2-4.3), filled with the same device functions that render.

   reads    rows: sine and cosine of the theta of each row; fibre, profiles
   writes   bins [TABLE_ROWS][FURCL_LOBES][TABLE_BINS]: mean over the bin of the channels' mean of
            A_p(h), by the trapezoidal rule: the ends of the bin count, so that a lobe that ends just
            inside it is seen
   over     TABLE_ROWS x TABLE_BINS
   next     furcl/tables.py turns the bins into CDFs */
#include "bcsdf.clh"

#define TABLE_STEPS 16u

/* Offsets lie even in a bin, in the last one dense at the rim: near |h| = 1 light goes over from the
   other lobes to R within a part of the bin that shrinks as eta and the layers do. */
static inline float place_in_bin(uint bin, uint k)
{
    const float left = 1.0f - (float)k * (1.0f / TABLE_STEPS);
    return 1.0f - (bin == FURCL_TABLE_BINS - 1u ? square(square(left)) : left);
}

__kernel void attenuation_bins(
    __global float* bins, __global const float2* rows, const FibreParams fibre,
    __global const float* profiles)
{
    const uint i = get_global_id(0);
    if (i >= FURCL_TABLE_ROWS * FURCL_TABLE_BINS) return;
    const uint row = i / FURCL_TABLE_BINS, bin = i % FURCL_TABLE_BINS;
    const Incidence in = incidence_at(&fibre, rows[row].x, rows[row].y);
    float sum[FURCL_LOBES];
    for (uint p = 0; p < FURCL_LOBES; p++) sum[p] = 0.0f;
    for (uint k = 0; k <= TABLE_STEPS; k++) {
        const float inside = place_in_bin(bin, k);
        const float share = 0.5f * (place_in_bin(bin, min(k + 1u, TABLE_STEPS)) -
                                    place_in_bin(bin, max(k, 1u) - 1u));
        const float h = ((float)bin + inside) * (1.0f / FURCL_TABLE_BINS);
        const BcsdfAtOffset b = bcsdf_at_offset(&fibre, profiles, &in, h);
        for (uint p = 0; p < FURCL_LOBES; p++)
            if (lobe_exists(p)) sum[p] += share * spectrum_mean(lobe_attenuation(p, &fibre, &b));
    }
    for (uint p = 0; p < FURCL_LOBES; p++)
        bins[(row * FURCL_LOBES + p) * FURCL_TABLE_BINS + bin] = sum[p];
}
