/* Stage 1. Starts one path a slot: a camera ray for its pixel and sample.

   reads    wave, camera; plan (with FURCL_PLANNED)
   writes   state: all planes of a new path; queue: the identity
   over     the wave's paths
   next     intersect_closest */
#include "camera/camera.clh"
#include "core/paths.clh"

__kernel void generate(
    __global float* state, __global uint* queue, const Wave wave, const Camera camera
#if FURCL_PLANNED
    , __global const uint* plan
#endif
    )
{
    const uint slot = get_global_id(0);
    if (slot >= wave.n_paths) return;
    const Paths paths = {state, wave.n_slots};
#if FURCL_PLANNED
    const PixelSample p = planned_sample(plan, &wave, slot);
    set_path_uint(paths, PS_PIXEL, slot, p.index);
    set_path_uint(paths, PS_SAMPLE, slot, p.sample);
#else
    const PixelSample p = pixel_of_slot(paths, &wave, slot);
#endif
    const CameraRay ray = camera_ray(&camera, &wave, p);
    set_path_float3(paths, PS_ORIGIN, slot, ray.origin);
    set_path_float3(paths, PS_DIR, slot, ray.direction);
    set_path_uint(paths, PS_FROM_SEGMENT, slot, FURCL_NO_SEGMENT);
    set_path_spectrum(paths, PS_THROUGHPUT, slot, spectrum(1.0f));
    set_path_spectrum(paths, PS_RADIANCE, slot, spectrum(0.0f));
#if FURCL_LIGHT_SAMPLING
    set_path_float(paths, PS_DIR_PDF, slot, 0.0f);
#endif
#if FURCL_FIRST_HITS
    set_path_uint(paths, PS_HIT_SEGMENT, slot, FURCL_NO_SEGMENT);  /* as long as nothing is met */
#endif
#if FURCL_LIGHT_LAYERS
    set_path_uint(paths, PS_FIRST, slot, FURCL_NOTHING_MET);
#endif
    queue[FURCL_SLOT(paths, slot)] = slot;
}
