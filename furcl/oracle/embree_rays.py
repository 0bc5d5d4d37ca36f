"""Embree's own flat linear curves and triangles: oracle for hits and yardstick for speed."""

import ctypes
import os

import numba
import numpy as np
from numpy.typing import NDArray

from furcl.bvh.embree import EmbreeDevice, library
from furcl.device.layout import TRIANGLE
from furcl.groom.curves import Curves
from furcl.oracle.native import atomic_add, call_query, floats_at, words_at

FLAT_LINEAR_CURVE, TRIANGLES = 17, 0
BUFFER_INDEX, BUFFER_VERTEX = 0, 1
FORMAT_UINT, FORMAT_UINT3, FORMAT_FLOAT3, FORMAT_FLOAT4 = 0x5001, 0x5003, 0x9003, 0x9004

RAYS_PER_TURN = 256
RAY_HIT_WORDS = 32  # RTCRayHit has 20 or 24, by how the library was configured


class EmbreeScene:
    """A groom as Embree's flat linear curves, and triangles beside it.

    Embree ignores hits nearer than twice the fibre's radius, whatever fibre it is. To ask for all
    hits from an origin on, every ray starts `backward` further back and its hits count from there
    on (tnear), which no node or segment that the ray really meets is left out by.
    """

    def __init__(self, curves: Curves, corners: NDArray[np.float32] | None = None):
        self._library, self._device = library(), EmbreeDevice()
        self._vertices = np.concatenate([curves.points, curves.radii[:, None]], axis=1)
        self.segments = curves.segment_vertices().astype(np.uint32)
        self.backward = np.float32(2.1 * float(curves.radii.max()))
        self.scene = self._library.rtcNewScene(self._device.handle)
        self._attach(
            FLAT_LINEAR_CURVE,
            (BUFFER_VERTEX, FORMAT_FLOAT4, self._vertices),
            (BUFFER_INDEX, FORMAT_UINT, self.segments[:, None]),
        )
        if corners is not None:
            # Embree may read 16 bytes at the last vertex.
            points = np.concatenate([corners.reshape(-1, 3), np.zeros((1, 3))]).astype(np.float32)
            numbers = np.arange(corners.size // 3, dtype=np.uint32).reshape(-1, 3)
            self._triangles = points, numbers
            self._attach(
                TRIANGLES,
                (BUFFER_VERTEX, FORMAT_FLOAT3, points),
                (BUFFER_INDEX, FORMAT_UINT3, numbers),
            )
        self._library.rtcCommitScene(self.scene)
        self._device.check("build a scene")
        self.n_threads = len(os.sched_getaffinity(0))
        self._intersect = _address(self._library.rtcIntersect1)
        self._occluded = _address(self._library.rtcOccluded1)

    def _attach(self, kind, *buffers):
        """Give the scene a geometry; it is numbered from 0 in the order of these calls."""
        geometry = self._library.rtcNewGeometry(self._device.handle, kind)
        for what, fmt, array in buffers:
            self._library.rtcSetSharedGeometryBuffer(
                geometry, what, 0, fmt, array.ctypes.data, 0, array.strides[0], len(array)
            )
        self._library.rtcCommitGeometry(geometry)
        self._library.rtcAttachGeometry(self.scene, geometry)
        self._library.rtcReleaseGeometry(geometry)

    def __del__(self):
        if getattr(self, "scene", None):
            self._library.rtcReleaseScene(self.scene)

    def intersect(self, origins, directions):
        """Nearest hits by rtcIntersect1 on all cores.

        Parameters
        ----------
        origins : (n, 4) float32        x, y, z, unused
        directions : (n, 4) float32     unit x, y, z, largest distance

        Returns
        -------
        t : (n,) float32
        segment : (n,) uint32           its first vertex, of triangles TRIANGLE + that; NO_SEGMENT
                                        for a miss
        u : (n,) float32                along the segment, 0..1
        """
        n = len(origins)
        t, u = np.empty(n, np.float32), np.empty(n, np.float32)
        primitive, geometry = np.empty(n, np.uint32), np.empty(n, np.uint32)
        _trace(
            self._intersect, self.scene, origins, directions, self.backward, self.n_threads,
            np.zeros(1, np.int64), t, primitive, geometry, u,
        )  # fmt: skip
        hit, triangle = geometry == 0, geometry == 1
        primitive[hit] = self.segments[primitive[hit]]
        primitive[triangle] = np.uint32(TRIANGLE) + np.uint32(3) * primitive[triangle]
        u[triangle] = 0.0
        return t, primitive, u

    def occluded(self, origins, directions):
        """True where rtcOccluded1 finds anything up to the largest distance; (n,) bool."""
        n = len(origins)
        t = np.empty(n, np.float32)
        _trace(
            self._occluded, self.scene, origins, directions, self.backward, self.n_threads,
            np.zeros(1, np.int64), t, np.empty(0, np.uint32), np.empty(0, np.uint32),
            np.empty(0, np.float32),
        )  # fmt: skip
        return np.isneginf(t)


def _address(function):
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


@numba.njit(cache=True, parallel=True, nogil=True)
def _trace(
    function, scene, origins, directions, backward, n_threads, turn, t, primitive, geometry, u
):
    """Fill t, and for closest hits the others; threads take rays a turn at a time."""
    n = len(origins)
    closest = len(primitive) > 0
    buffers = np.empty((n_threads, RAY_HIT_WORDS + 16), np.float32)
    for thread in numba.prange(n_threads):
        address = (buffers[thread].ctypes.data + 63) & ~63
        ray = floats_at(address, RAY_HIT_WORDS)
        words = words_at(address, RAY_HIT_WORDS)
        while True:
            first = atomic_add(turn.ctypes.data, RAYS_PER_TURN)
            if first >= n:
                break
            for i in range(first, min(first + RAYS_PER_TURN, n)):
                for k in range(3):
                    ray[k] = origins[i, k] - backward * directions[i, k]
                    ray[4 + k] = directions[i, k]
                ray[3] = backward
                ray[7] = 0.0
                ray[8] = directions[i, 3] + backward
                words[9] = 0xFFFFFFFF
                words[10] = 0
                words[11] = 0
                words[17] = 0xFFFFFFFF
                words[18] = 0xFFFFFFFF
                words[19] = 0xFFFFFFFF
                call_query(function, scene, address, 0)
                t[i] = ray[8] - backward
                if closest:
                    primitive[i] = words[17]
                    geometry[i] = words[18]
                    u[i] = ray[15]
