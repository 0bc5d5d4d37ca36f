/* Stage 1 of 5. Starts one path a slot: a camera ray for its pixel and sample.

   reads    wave, camera
   writes   state: all planes of a new path; queue: the identity
   over     the wave's paths
   next     intersect */
#include "camera/camera.clh"
#include "core/spectrum.clh"

__kernel void generate(
    __global float* state, __global uint* queue, const Wave wave, const Camera camera)
{
    const uint slot = get_global_id(0);
    if (slot >= wave.n_paths) return;
    const uint n_slots = wave.n_slots;
    const CameraRay ray = camera_ray(&camera, &wave, pixel_of_slot(&wave, slot));
    PS_STORE3(ORIGIN, slot, ray.origin);
    PS_STORE3(DIR, slot, ray.direction);
    PS_U(SKIP_SEGMENT, slot) = FURCL_NO_SEGMENT;
    PS_F(SKIP_DISTANCE, slot) = 0.0f;
    PS_STORE_SPECTRUM(THROUGHPUT, slot, SPECTRUM(1.0f));
    PS_STORE_SPECTRUM(RADIANCE, slot, SPECTRUM(0.0f));
#if FURCL_LIGHT_SAMPLING
    PS_F(DIR_PDF, slot) = 0.0f;
#endif
    FURCL_AT(queue, slot, n_slots) = slot;
}
