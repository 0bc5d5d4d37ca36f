/* Stage before the film, while paths are recorded. Counts what came back along rays, by cell.

   `counts` holds FURCL_LEARNED_COUNTS whole numbers a cell: rays by the binary exponent of the radiance that came
   back (bits of a float32 over 2^23: 256 of them), rays that followed, rays that met nothing. Sums of whole
   numbers are the same in every order.

   reads    state: RADIANCE; records
   writes   counts; records: empty again
   over     the wave's paths
   next     add_to_film */
#include <learning>

__kernel void learn(
    __global float* state, __global uint* records, __global uint* counts, const Wave wave)
{
    const uint slot = get_global_id(0);
    if (slot >= wave.n_paths) return;
    const Paths paths = {state, wave.n_slots};
    const Learned learned = {0, records, wave.n_slots};
    const float found = spectrum_mean(path_spectrum(paths, PS_RADIANCE, slot));
    /* From the last ray to the first: what followed is known. */
    uint n_rays = 0u;
    uint after = 0u;
    float before_after = 0.0f;
    for (int n = FURCL_RECORDED_RAYS; n >= 0; n--) {
        __global uint* record = record_of(&learned, (uint)n, slot);
        const uint what = record[FURCL_RECORD_CELL];
        const float radiance = as_float(record[FURCL_RECORD_RADIANCE]);
        const float throughput = as_float(record[FURCL_RECORD_THROUGHPUT]);
        record[FURCL_RECORD_CELL] = record[FURCL_RECORD_THROUGHPUT] = 0u;
        if (throughput > 0.0f && after != 0u) {
            n_rays++;
            __global uint* of_cell =
                counts + FURCL_LEARNED_COUNTS * (what & FURCL_RECORD_CELL_MASK);
            const float back = fmax(found - before_after, 0.0f) / throughput;
            atomic_inc(of_cell + (as_uint(back) >> 23));
            atomic_add(of_cell + FURCL_LEARNED_RAYS, n_rays);
            if (after & FURCL_RECORD_MISSED) atomic_inc(of_cell + FURCL_LEARNED_MISSED);
        }
        if (what & FURCL_RECORD_SHADOW) n_rays++;
        after = what;
        before_after = radiance;
    }
}
