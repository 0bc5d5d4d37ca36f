/* The two factors of the density of lobe R, TT or TRT of the double cylinder, each alone.

   reads    (sin, cos) of theta of wo; (s, c, azimuth, azimuth from the lobe's centre) of wi; material
   writes   longitudinal and azimuthal density
   over     n */
#include <fibre>

__kernel void double_cylinder_densities(
    __global const float2* theta, __global const float4* to, __global float* longitudinal,
    __global float* azimuthal, const uint n, const uint lobe, __global const float* material)
{
    const uint i = get_global_id(0);
    if (i >= n) return;
    const Fibre fibre = fibre_of(material);
    const Incidence in = incidence_at(&fibre, theta[i].x, theta[i].y);
    const Longitudinal l = longitudinal_of(lobe, &fibre, &in, to[i].z);
    longitudinal[i] = longitudinal_density(&l, to[i].x, to[i].y);
    azimuthal[i] = azimuthal_density(to[i].w, azimuthal_beta(lobe, fibre.params.beta_n));
}
