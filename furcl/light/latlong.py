"""Latitude-longitude light images: lookup and importance sampling.

Row 0 is +z, the last row -z. The middle column is +x and the picture's right half is -y, as one
sees it from inside (not mirrored); a rotation turns the light from +x towards +y.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from furcl.cdf import inclusive_cdf
from furcl.errors import ImageError
from furcl.image.colour import luminance
from furcl.image.exr import read_exr, rgb_of
from furcl.image.hdr import is_hdr, read_hdr
from furcl.light.compensation import compensated_power

log = logging.getLogger(__name__)

Array = NDArray[np.float64]

# Every cell keeps this part of its row's mean chance, and at least a step that float32 can hold.
FLOOR_SHARE = 1e-3
FLOOR_STEP = 2.0**-22

# Sums of squares of a million samples of it are float32 numbers.
LARGEST_RADIANCE = 1e15

# What copies, and float64 values, are made of.
ROWS_AT_ONCE = 64

# Width over height of what is taken for latitude and longitude without a word.
ASPECTS = (1.5, 3.0)


@dataclass(frozen=True, eq=False)
class LatLong:
    """An image of the light, bilinear between pixel centres.

    Attributes
    ----------
    texels : (H, W, 3) float32
    marginal : (H,) float32         upper edges of the rows' cumulative chances, last entry 1
    conditional : (H, W) float32    of the columns' within each row, last entries 1
    rotation : float                about +z [turns]
    n_negative : int                pixels with a negative channel, which was set to zero

    Cells are the pixels. A cell's chance goes with the luminance of the bilinear interpolant
    averaged over it, less a part of the mean (`furcl.light.compensation`), and is positive wherever
    the interpolant is; inside, directions are uniform in solid angle. The density is taken from the
    differences of the float32 tables, so it is exactly what sampling gives, and no formula divides
    by sin(theta) at the poles.
    """

    texels: NDArray[np.float32]
    marginal: NDArray[np.float32]
    conditional: NDArray[np.float32]
    rotation: float
    n_negative: int

    @classmethod
    def load(cls, path: str | Path, *, rotation_deg: float = 0.0, scale: float = 1.0) -> LatLong:
        """Read an OpenEXR or Radiance image, told by its first bytes whatever its name.

        Other primaries are converted to Rec.709. An image that covers a part of its window is black
        elsewhere. One far from twice as wide as high is read, with a warning.

        Raises
        ------
        ImageError      as `make` and the readers do; radiance above LARGEST_RADIANCE; an OpenEXR
                        file that says that it is a cube
        """
        rgb = read_hdr(path) if is_hdr(path) else _read_exr(path)
        height, width, _ = rgb.shape
        if not ASPECTS[0] <= width / height <= ASPECTS[1]:
            log.warning(
                "%s: %d x %d pixels, read as latitude and longitude, which are twice as wide as "
                "high; is it another projection?",
                path,
                width,
                height,
            )
        image = cls.make(rgb, rotation_deg=rotation_deg, scale=scale, source=str(path))
        if image.texels.max() > LARGEST_RADIANCE:
            row, column = (int(i) for i in np.argwhere(image.texels > LARGEST_RADIANCE)[0][:2])
            raise ImageError(
                f"{path}: the pixel in column {column}, row {row} is "
                f"{float(rgb[row, column].max()):g}, times the scale {scale:g}; at most "
                f"{LARGEST_RADIANCE:g} is rendered, since the variance holds squares in float32; "
                f"use a smaller scale or repair the image"
            )
        return image

    @classmethod
    def make(
        cls,
        rgb: NDArray[np.float32],
        *,
        rotation_deg: float = 0.0,
        scale: float = 1.0,
        source: str = "environment",
    ) -> LatLong:
        """Check a picture (H, W, 3) and build its tables.

        Raises
        ------
        ImageError      NaN or infinite pixels, or an image without any light
        """
        height, width, _ = rgb.shape
        texels = np.empty((height, width, 3), np.float32)
        n_negative = 0
        for part in _strips(height):
            if not np.isfinite(rgb[part]).all():
                _refuse_bad(rgb, source)
            n_negative += int((rgb[part] < 0.0).any(axis=2).sum())
            with np.errstate(over="ignore"):
                np.maximum(rgb[part], 0.0, out=texels[part])
                texels[part] *= np.float32(scale)
            if not np.isfinite(texels[part]).all():
                raise ImageError(
                    f"{source}: times the scale {scale:g} overflows float32; use a smaller scale"
                )

        def weights_of(part: slice) -> NDArray[np.float64]:
            # What the cells hold goes with the rows above and below.
            first = max(part.start - 1, 0)
            values = np.asarray(luminance(texels[first : part.stop + 1]), np.float64)
            return _cell_weights(values)[part.start - first :][: part.stop - part.start]

        bands = -np.diff(np.cos(np.linspace(0.0, math.pi, height + 1)))[:, None]
        angles = bands * (2.0 * math.pi / width)
        total = sum(float((weights_of(p) * angles[p]).sum()) for p in _strips(height))
        if total == 0.0:
            raise ImageError(f"{source}: every pixel is black; a light image needs light")
        conditional, marginal = np.empty((height, width), np.float32), np.empty(height)
        for part in _strips(height):
            power = compensated_power(weights_of(part) * angles[part], angles[part], total)
            marginal[part] = power.sum(axis=1)
            conditional[part] = _cdf(power)
        return cls(
            texels=texels,
            marginal=_cdf(marginal[None])[0],
            conditional=conditional,
            rotation=rotation_deg / 360.0,
            n_negative=n_negative,
        )

    def radiance(self, dirs: Array) -> Array:
        """Radiance from unit directions (n, 3), (n, 3) float64."""
        height, width, _ = self.texels.shape
        u, v = self._place(dirs)
        x, y = u * width - 0.5, v * height - 0.5
        x0, y0 = np.floor(x), np.floor(y)
        fx, fy = (x - x0)[:, None], (y - y0)[:, None]
        columns = [np.mod(x0.astype(int) + i, width) for i in (0, 1)]
        rows = [np.clip(y0.astype(int) + i, 0, height - 1) for i in (0, 1)]
        texels = self.texels.astype(np.float64)
        top, bottom = (
            texels[row, columns[0]] * (1.0 - fx) + texels[row, columns[1]] * fx for row in rows
        )
        return top * (1.0 - fy) + bottom * fy

    def pdf(self, dirs: Array) -> Array:
        """Density of `sample` per solid angle (n,) at unit directions (n, 3)."""
        height, width, _ = self.texels.shape
        u, v = self._place(dirs)
        row = np.minimum((v * height).astype(int), height - 1)
        column = np.minimum((u * width).astype(int), width - 1)
        return self._cell_pdf(row, column)

    def sample(self, u: Array) -> tuple[Array, Array]:
        """Unit directions (n, 3) and their densities (n,) from uniform numbers (n, 2) in [0, 1)."""
        height, width, _ = self.texels.shape
        row = np.minimum(np.searchsorted(self.marginal, u[:, 1], side="right"), height - 1)
        low, high = self._edges(self.marginal[None], 0, row)
        t_row = (u[:, 1] - low) / (high - low)
        # One search for all: row r's sums are shifted to r .. r + 1, exactly in float64.
        steps = (self.conditional + np.arange(height, dtype=np.float64)[:, None]).ravel()
        column = np.searchsorted(steps, row + u[:, 0], side="right") - row * width
        column = np.clip(column, 0, width - 1)
        low, high = self._edges(self.conditional, row, column)
        t_column = (u[:, 0] - low) / (high - low)
        top, bottom = (1.0 - np.cos((row + i) * (math.pi / height)) for i in (0, 1))
        one_minus_cos = top + t_row * (bottom - top)
        level = np.sqrt(one_minus_cos * (2.0 - one_minus_cos))
        phi = 2.0 * math.pi * (0.5 + self.rotation - (column + t_column) / width)
        dirs = np.stack([level * np.cos(phi), level * np.sin(phi), 1.0 - one_minus_cos], axis=1)
        return dirs, self._cell_pdf(row, column)

    def _place(self, dirs: Array) -> tuple[Array, Array]:
        """Picture coordinates: u in [0, 1) from the left, v in [0, 1] from the top."""
        x, y, z = dirs.T
        u = 0.5 + self.rotation - np.arctan2(y, x) / (2.0 * math.pi)
        return u - np.floor(u), np.arctan2(np.hypot(x, y), z) / math.pi

    def _edges(self, cdf: NDArray[np.float32], row, column) -> tuple[Array, Array]:
        high = cdf[row, column].astype(np.float64)
        return np.where(column > 0, cdf[row, np.maximum(column - 1, 0)], 0.0), high

    def _cell_pdf(self, row, column) -> Array:
        height, width, _ = self.texels.shape
        low, high = self._edges(self.marginal[None], 0, row)
        left, right = self._edges(self.conditional, row, column)
        band = np.cos(row * (math.pi / height)) - np.cos((row + 1) * (math.pi / height))
        return (high - low) * (right - left) / (band * (2.0 * math.pi / width))


def _strips(height: int) -> Iterator[slice]:
    """Parts of so many rows, of which copies are made."""
    for row in range(0, height, ROWS_AT_ONCE):
        yield slice(row, min(row + ROWS_AT_ONCE, height))


def _refuse_bad(rgb: NDArray[np.float32], source: str) -> NoReturn:
    n_bad, first = 0, None
    for part in _strips(len(rgb)):
        bad = ~np.isfinite(rgb[part])
        n_bad += int(bad.any(axis=2).sum())
        if first is None and bad.any():
            row, column, channel = (int(i) for i in np.argwhere(bad)[0])
            first = (part.start + row, column, channel)
    assert first is not None
    row, column, channel = first
    raise ImageError(
        f"{source}: {'RGB'[channel]} of the pixel in column {column}, row {row} is "
        f"{rgb[first]} ({n_bad} such pixels); repair the image"
    )


def _read_exr(path: str | Path) -> NDArray[np.float32]:
    """The picture of an OpenEXR file that is, or may be, in latitude and longitude."""
    channels, header = read_exr(path)
    projection = header.get("envmap")
    if projection is not None and "LATLONG" not in str(projection).upper():
        raise ImageError(
            f"{path}: its attribute envmap is {str(projection).split('.')[-1]}; only latitude and "
            f"longitude are read; convert it (exrenvmap -latlong)"
        )
    return rgb_of(channels, header, path)


def _cell_weights(values: Array) -> Array:
    """Mean over each cell of the bilinear interpolant of (H, W): 1/8, 3/4, 1/8 on both axes."""
    across = 0.75 * values + 0.125 * (np.roll(values, 1, axis=1) + np.roll(values, -1, axis=1))
    above = np.concatenate([across[:1], across[:-1]])
    below = np.concatenate([across[1:], across[-1:]])
    return 0.75 * across + 0.125 * (above + below)


def _cdf(weights: Array) -> NDArray[np.float32]:
    """Cumulative chances along the last axis (.., n) in float32, rising at every entry."""
    n = weights.shape[1]
    total = weights.sum(axis=1, keepdims=True)
    share = np.where(total > 0.0, weights / np.where(total > 0.0, total, 1.0), 1.0 / n)
    share = share + max(FLOOR_SHARE / n, FLOOR_STEP)
    return inclusive_cdf(share / share.sum(axis=1, keepdims=True))
