/* Stage 1. Starts one path a slot: a camera ray for its pixel and sample.

   reads    wave, camera; plan (with FURCL_PLANNED), shutter (where something moves)
   writes   state: all planes of a new path; queue: the identity
   over     the wave's paths, FURCL_PATHS_PER_ITEM a work-item
   next     intersect_closest */
#include "camera/camera.clh"
#include "core/path_numbers.clh"
#if FURCL_MOTION || FURCL_CAMERA_MOTION
#include "camera/shutter.clh"
#endif
#include "core/queue_lanes.clh"

__kernel void generate(
    __global float* state, __global uint* queue, const Wave wave, const Camera camera
#if FURCL_PLANNED
    , __global const uint* plan
#endif
#if FURCL_MOTION || FURCL_CAMERA_MOTION
    , __global const float* shutter
#endif
    )
{
    const Paths paths = {state, wave.n_slots};
    const Entries entries = entries_of_item(wave.n_paths);
    for (uint first = 0; first < FURCL_PATHS_PER_ITEM && first < entries.n; first += FURCL_LANES) {
        /* Numbers in lanes; lanes beyond the last path repeat it. */
        PixelSample of_lane[FURCL_LANES];
        UintLanes pixel, sample;
        for (uint k = 0; k < FURCL_LANES; k++) {
            const uint slot = entries.begin + min(first + k, entries.n - 1u);
#if FURCL_PLANNED
            of_lane[k] = planned_sample(plan, &wave, slot);
#else
            of_lane[k] = pixel_of_slot(paths, &wave, slot);
#endif
            set_uint_lane(&pixel, k, of_lane[k].index);
            set_uint_lane(&sample, k, of_lane[k].sample);
        }
        const Lanes4 xi = path_number_lanes(&wave, pixel, sample, DIM_FILM);
#if FURCL_MOTION || FURCL_CAMERA_MOTION
        const Lanes4 parts = path_number_lanes(&wave, pixel, sample, DIM_TIME);
#endif
        for (uint k = 0; k < lanes_in_use(first, entries); k++) {
            const uint slot = entries.begin + first + k;
#if FURCL_PLANNED
            set_path_uint(paths, PS_PIXEL, slot, of_lane[k].index);
            set_path_uint(paths, PS_SAMPLE, slot, of_lane[k].sample);
#endif
#if FURCL_MOTION
            set_path_float(paths, PS_TIME, slot, groom_time(shutter, lane(&parts.x, k)));
#endif
#if FURCL_CAMERA_MOTION
            const Camera moved = moved_camera(&camera, shutter, lane(&parts.x, k));
            const CameraRay ray = camera_ray(&moved, &wave, of_lane[k], lane4(&xi, k));
#else
            const CameraRay ray = camera_ray(&camera, &wave, of_lane[k], lane4(&xi, k));
#endif
            set_path_float3(paths, PS_ORIGIN, slot, ray.origin);
            set_path_float3(paths, PS_DIR, slot, ray.direction);
            set_path_uint(paths, PS_FROM_SEGMENT, slot, FURCL_NO_SEGMENT);
            set_path_spectrum(paths, PS_THROUGHPUT, slot, spectrum(1.0f));
            set_path_spectrum(paths, PS_RADIANCE, slot, spectrum(0.0f));
#if FURCL_LIGHT_SAMPLING
            set_path_float(paths, PS_DIR_PDF, slot, 0.0f);
#endif
#if FURCL_FIRST_HITS
            /* as long as nothing is met */
            set_path_uint(paths, PS_HIT_SEGMENT, slot, FURCL_NO_SEGMENT);
#endif
#if FURCL_LIGHT_LAYERS
            set_path_uint(paths, PS_FIRST, slot, FURCL_NOTHING_MET);
#endif
            queue[FURCL_SLOT(paths, slot)] = slot;
        }
    }
}
