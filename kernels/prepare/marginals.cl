/* Marginal densities (docs/model.md, Light samples): of the sampler's lobe and azimuth, whatever its h.

   reads    rows: sine and cosine of the theta of each row; material, with its attenuation tables
   writes   sums [TABLE_ROWS][MARGINAL_PARTS][MARGINAL_PHIS][FURCL_LOBES]: the mean over a part's h of the
            density of lobe p and of +-phi
   over     TABLE_ROWS x MARGINAL_PARTS
   next     furcl/fibre/marginal.py adds up the parts */
#include "fibre/sampler.clh"

__kernel void marginal_densities(
    __global float* sums, __global const float2* rows, __global const float* material)
{
    const uint i = get_global_id(0);
    if (i >= FURCL_TABLE_ROWS * FURCL_MARGINAL_PARTS) return;
    const Fibre fibre = fibre_of(material);
    const float2 row = rows[i / FURCL_MARGINAL_PARTS];
    const uint part = i % FURCL_MARGINAL_PARTS;
    const Incidence in = incidence_at(&fibre, row.x, row.y);
    __global float* out = sums + (size_t)i * FURCL_MARGINAL_PHIS * FURCL_LOBES;
    for (uint j = 0; j < FURCL_MARGINAL_PHIS * FURCL_LOBES; j++) out[j] = 0.0f;
    /* Midpoints even in gamma = asin(h), of which the azimuth of a lobe is nearly linear; sides in turn. */
    for (uint k = part; k < FURCL_MARGINAL_OFFSETS; k += FURCL_MARGINAL_PARTS) {
        const float step = HALF_PI / FURCL_MARGINAL_OFFSETS;
        float cos_gamma;
        const float sin_gamma = sincos_turns(INV_TWO_PI * ((float)k + 0.5f) * step, &cos_gamma);
        const float h = (k / FURCL_MARGINAL_PARTS) & 1u ? -sin_gamma : sin_gamma;
        const BcsdfAtOffset b = bcsdf_at_offset(&fibre, &in, h);
        float joints[FURCL_LOBES];
        joint_densities(&fibre, &in, &b, joints);
        for (uint p = 0; p < FURCL_LOBES; p++) {
            if (!lobe_exists(p) || joints[p] <= 0.0f) continue;
            const float share = 0.5f * step * cos_gamma * joints[p];
            for (uint j = 0; j < FURCL_MARGINAL_PHIS; j++) {
                const float spacing = PI / (FURCL_MARGINAL_PHIS - 1), phi = (float)j * spacing;
                out[j * FURCL_LOBES + p] += share *
                    (lobe_azimuth_density(p, &fibre, &b, phi, 0.5f * spacing) +
                     lobe_azimuth_density(p, &fibre, &b, -phi, 0.5f * spacing));
            }
        }
    }
}
