/* Self-test: one small kernel for each feature of OpenCL C that furcl's kernels use. A device that
   compiles these and returns what furcl/device/selftest.py computes with numpy is fit for rendering. */

#include "core/sobol.clh"
#include "core/rng.clh"

/* Reads x (8 n floats), writes y (8 n floats). Launched over n. */
__attribute__((vec_type_hint(float8)))
__kernel void selftest_vectors(__global const float* x, __global float* y)
{
    const size_t i = get_global_id(0);
    const float8 v = vload8(i, x);
    const float8 wave = fma(sin(v), cos(v), exp(-v) * rsqrt(1.0f + v * v));
    const float8 chosen = select(wave, log(1.0f + v), v > (float8)(2.0f));
    vstore8(fmin(fmax(chosen, -4.0f), 4.0f).s76543210, i, y);
}

/* Vectors wider than a register go into functions and come out of them whole. */
static inline float16 widened(uchar16 bytes, float16 by) { return fma(convert_float16(bytes), by, -by); }

/* Reads bytes (16 n), writes y (16 n floats): 0.5 byte - 0.5. Launched over n. */
__kernel void selftest_wide(__global const uchar16* bytes, __global float* y)
{
    const size_t i = get_global_id(0);
    vstore16(widened(bytes[i], (float16)(0.5f)), i, y);
}

/* Scalar and integer functions: reads x, writes y (floats) and z (uints). Launched over n. */
__kernel void selftest_scalars(__global const float* x, __global float* y, __global uint* z)
{
    const size_t i = get_global_id(0);
    const float u = x[i] / (1.0f + x[i]);
    y[i] = asin(u) + atan2(u, 2.0f) + pow(1.0f + u, 0.3f) - expm1(-u) + copysign(u, -1.0f);
    z[i] = clz((uint)i) + popcount((uint)i) + mul_hi((uint)i, 0x9E3779B9u) + as_uint(x[i]);
}

/* Queue push: keeps the indices whose flag is not 0, reserving room once a work-group. Reads flags
   (n), writes kept (count in any order) and count (1, zeroed before). Launched over n. */
__kernel void selftest_queue(
    __global const uint* flags, __global uint* kept, volatile __global uint* count)
{
    volatile __local uint shared[2];
    const uint i = get_global_id(0);
    if (get_local_id(0) == 0) shared[0] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    uint place = 0;
    if (flags[i]) place = atomic_inc(&shared[0]);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (get_local_id(0) == 0) shared[1] = atomic_add(count, shared[0]);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (flags[i]) kept[shared[1] + place] = i;
}

/* Writes numbers (4 n floats): pixel i, sample 2 i, dimension 3. Launched over n. */
__kernel void selftest_random(uint seed, __global float* numbers)
{
    const uint i = get_global_id(0);
    vstore4(uniform4(seed, i, 2u * i, 3u), i, numbers);
}

/* Writes bits (4 n words) of Sobol points: pixel i, sample i * i, dimension 3. Launched over n. */
__kernel void selftest_sobol(uint seed, __global uint* bits)
{
    const uint i = get_global_id(0);
    vstore4(sobol_point(seed, i, i * i, 3u), i, bits);
}

/* A struct passed by value. Writes its size, the offsets of its fields and its content. Launched over 1. */
__kernel void selftest_struct(__global uint* out, const Example given)
{
    const char* start = (const char*)&given;
    out[0] = sizeof(Example);
    out[1] = (uint)((const char*)&given.vector - start);
    out[2] = (uint)((const char*)&given.real - start);
    out[3] = (uint)((const char*)&given.whole - start);
    out[4] = (uint)((const char*)&given.pair_x - start);
    out[5] = (uint)((const char*)&given.pair_y - start);
    out[6] = (uint)((const char*)&given.last - start);
    for (uint i = 0; i < sizeof(Example) / sizeof(uint); i++) out[7 + i] = ((const uint*)&given)[i];
}
