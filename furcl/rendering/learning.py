"""What is learned while rendering: what rays are worth, by where they begin and where they go.

Russian roulette keeps a ray with the chance that its throughput over a threshold is. The best
threshold differs: a throughput T times sqrt(E[L^2] / C), L the radiance that comes back and C the
rays that follow, wants to be kept with that over sqrt(V / C_0) as its chance, V the variance of a
sample of the picture and C_0 its rays (Rath et al. 2022; without costs Vorba and Křivánek 2016).
For a light sample L is its radiance where nothing hides it, and C is 1.

Rays are told apart by cells (kernels/include/learning/adjoint.clh): the optical depth of the groom
before them, and which of 26 directions they are nearest to. So any groom has them, and no surface
is needed.

The first samples of all pixels are recorded, and after some numbers of samples (ENDS) the
thresholds, constants until then, are set from all that was recorded. Recorded samples count for the
picture: given all samples before it, the next one has the same mean whatever the chances are, as
long as they are positive and fixed before it is taken; so the mean of a pixel's samples is without
bias, and their differences from it are uncorrelated, so that the variance of the mean is too.
Counts are whole numbers, added in any order, and thresholds are set at numbers of samples: the
picture is the same to the bit however the work is cut into waves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl

from furcl.device.layout import Fields, struct_dtype
from furcl.device.memory import Memory, fill
from furcl.groom.optical_depth import DIRECTIONS, OpticalDepths

GRID: Fields = (
    ("corner", "float4"),  # w: voxels a unit of length
    ("nx", "uint"),
    ("ny", "uint"),
    ("nz", "uint"),
    ("unused", "uint"),
)

# Cells: directions by classes of depths, in octaves of 1 + 8 optical depths.
N_DEPTHS = 8
N_CELLS = len(DIRECTIONS) * N_DEPTHS

RECORDED_RAYS = 8
RECORD_WORDS = 4
RECORDS = RECORD_WORDS * (RECORDED_RAYS + 1)  # words a path
# Of each cell: rays by the exponent of what came back, rays that followed, rays that met nothing.
N_EXPONENTS = 256
N_COUNTS = N_EXPONENTS + 2


@dataclass(frozen=True)
class LearningPart:
    """The part of `Features` that the kernels learn with."""

    name: str = "adjoint"
    header: Path = Path("learning/adjoint.clh")

    def defines(self) -> Mapping[str, int | str]:
        """Sizes of tables and records."""
        return {
            "FURCL_LEARNED_CELLS": N_CELLS,
            "FURCL_LEARNED_DEPTHS": N_DEPTHS,
            "FURCL_LEARNED_COUNTS": N_COUNTS,
            "FURCL_LEARNED_RAYS": N_EXPONENTS,
            "FURCL_LEARNED_MISSED": N_EXPONENTS + 1,
            "FURCL_RECORDED_RAYS": RECORDED_RAYS,
            "FURCL_RECORD_WORDS": RECORD_WORDS,
            "FURCL_RECORD_CELL": 0,
            "FURCL_RECORD_THROUGHPUT": 1,
            "FURCL_RECORD_RADIANCE": 2,
            "FURCL_RECORD_HIT": "0x80000000u",
            "FURCL_RECORD_MISSED": "0x40000000u",
            "FURCL_RECORD_SHADOW": "0x20000000u",
            "FURCL_RECORD_CELL_MASK": "0xffffu",
        }

    def structs(self) -> Mapping[str, Fields]:
        """The head of what is learned."""
        return {"LearnedGrid": GRID}

    def as_dict(self) -> Mapping[str, Any]:
        """Nothing but its name."""
        return {}


# Samples of every pixel after which thresholds are set: the first of them, where that is so many
# paths, else all.
ENDS = (2, 4)
ENOUGH_PATHS = 1 << 17
# Paths that are recorded at most: sums of rays of all of them stay below 2^32.
MOST_PATHS = 1 << 24

# What a cell's neighbours weigh, in rays: cells of fewer rays are mostly as these are.
PRIOR_RAYS = 64
# Thresholds of paths are at most this, so that roulette raises no throughput above it, and at least
# that, so that where all samples are nearly alike paths do not go on for ever.
MAX_THRESHOLD, MIN_THRESHOLD = 4.0, 0.01
# The least chance of a light sample to be seen that is believed.
MIN_VISIBLE = 1.0 / 64.0
# Mean square over the square of the least of numbers uniform in their logarithm within an octave.
OCTAVE = 1.5 / math.log(2.0)


class Buffers:
    """What learning needs on the device, for a wave of `n_slots` paths."""

    def __init__(self, memory: Memory, n_slots: int) -> None:
        self.table_words = struct_dtype(GRID).itemsize // 4 + 2 * N_CELLS
        # A grid of one voxel, and thresholds of zero: no roulette.
        self.table = memory.allocate("learned", 4 * self.table_words + 32, zero=True)
        self.records = memory.allocate("learning records", 4 * RECORDS * n_slots, zero=True)
        self.counts = memory.allocate("learning counts", 4 * N_CELLS * N_COUNTS, zero=True)


class Learning:
    """The thresholds of a render, from its start on.

    Parameters
    ----------
    memory : Memory
    buffers : Buffers               of the wavefront
    depths : OpticalDepths          of the groom
    n_pixels : int
    path_threshold : float          of all cells, until something is learned
    shadow_threshold : float        likewise, of light samples [radiance]

    Attributes
    ----------
    ends : tuple of int         paths after which the thresholds are set: whole samples
    recorded : int              paths that are recorded: the first so many
    """

    def __init__(
        self,
        memory: Memory,
        buffers: Buffers,
        depths: OpticalDepths,
        n_pixels: int,
        path_threshold: float,
        shadow_threshold: float,
    ) -> None:
        self._memory, self._buffers = memory, buffers
        self.begin_with(path_threshold, shadow_threshold)
        self.of_pixels(n_pixels)
        grid, voxels = _packed(depths)
        self._head = len(grid)
        memory.release("learned", buffers.table)
        buffers.table = memory.allocate("learned", grid.nbytes + self._start.nbytes + voxels.nbytes)
        whole = np.concatenate([grid, self._start.view(np.uint32), voxels.view(np.uint32)])
        cl.enqueue_copy(memory.device.queue, buffers.table, whole)

    def begin_with(self, path_threshold: float, shadow_threshold: float) -> None:
        """Thresholds that `forget` sets."""
        self._start = np.repeat(np.array([path_threshold, shadow_threshold], np.float32), N_CELLS)

    def of_pixels(self, n_pixels: int) -> None:
        """Learn from a picture of so many pixels, of which there are no samples yet."""
        enough = next((n for n in ENDS if n * n_pixels >= ENOUGH_PATHS), ENDS[-1])
        self.ends = tuple(n * n_pixels for n in ENDS if n <= enough)
        self.recorded = min(self.ends[-1], MOST_PATHS)

    def forget(self) -> None:
        """Start again."""
        fill(self._memory.device.queue, self._buffers.counts, 0, self._buffers.counts.size)
        self._set(self._start)

    def parts(self) -> dict[str, cl.Buffer]:
        """The buffers of what was learned, which a render that goes on has to have."""
        return {"learned": self._buffers.table, "learning counts": self._buffers.counts}

    def end_of_wave(self, done: int, end: int) -> int:
        """Where a wave that begins with path `done` ends at most: at `end`, where thresholds are
        set, or where recording ends."""
        return min(n for n in (end, self.recorded, *self.ends) if n > done)

    def update(self, variance: float, rays: float) -> None:
        """Set the thresholds.

        Parameters
        ----------
        variance : float    of a sample, mean over the picture [radiance^2]
        rays : float        of a path, of all kinds
        """
        shape = (N_CELLS, N_COUNTS)
        counts = self._memory.read(self._buffers.counts, shape, np.uint32).astype(np.float64)
        if np.isfinite(variance) and variance > 0.0:
            paths, shadows = thresholds(counts, math.sqrt(variance / rays))
            self._set(np.concatenate([paths, shadows]).astype(np.float32))

    def _set(self, values: np.ndarray) -> None:
        queue = self._memory.device.queue
        cl.enqueue_copy(queue, self._buffers.table, values, dst_offset=4 * self._head)


def thresholds(counts: np.ndarray, kept: float) -> tuple[np.ndarray, np.ndarray]:
    """Thresholds of paths and of light samples, (N_CELLS,) each, from counts (N_CELLS, N_COUNTS).

    `kept` is sqrt(V / C_0) of the picture. Means of cells are drawn towards those of all cells with
    the same optical depth, and these towards the mean of all.
    """
    counts = counts.reshape(len(DIRECTIONS), N_DEPTHS, N_COUNTS)
    exponents = np.arange(N_EXPONENTS) - 127.0
    square = OCTAVE * np.exp2(2.0 * exponents)
    square[[0, -1]] = 0.0  # nothing came back; no number
    n = counts[..., :N_EXPONENTS].sum(axis=-1)
    sums = np.stack([counts[..., :N_EXPONENTS] @ square, *np.moveaxis(counts[..., -2:], -1, 0)])
    prior = sums.sum(axis=(1, 2), keepdims=True) / max(n.sum(), 1.0)
    for axis in ((1,), ()):
        total = sums.sum(axis=axis, keepdims=True) if axis else sums
        weight = n.sum(axis=0, keepdims=True) if axis else n
        prior = (total + PRIOR_RAYS * prior) / (weight + PRIOR_RAYS)
    worth, cost, visible = (mean.ravel() for mean in prior)
    with np.errstate(divide="ignore", invalid="ignore"):
        paths = kept * np.sqrt(np.maximum(cost, 1.0) / worth)
    return (
        np.clip(np.nan_to_num(paths, nan=MAX_THRESHOLD), MIN_THRESHOLD, MAX_THRESHOLD),
        kept / np.sqrt(np.maximum(visible, MIN_VISIBLE)),
    )


def _packed(depths: OpticalDepths) -> tuple[np.ndarray, np.ndarray]:
    """The struct LearnedGrid as words; the class of depth of every voxel and direction as bytes."""
    grid = np.zeros((), struct_dtype(GRID))
    grid["corner"][:3], grid["corner"][3] = depths.corner, 1.0 / depths.voxel
    for name, size in zip(("nx", "ny", "nz"), depths.depths.shape, strict=False):
        grid[name] = size
    classes = np.minimum(np.log2(1.0 + 8.0 * depths.depths), N_DEPTHS - 1).astype(np.uint8).ravel()
    # Filled up to whole words.
    return grid.reshape(1).view(np.uint32), np.pad(classes, (0, -len(classes) % 4))
