"""Rendered pictures: mean, variance of the mean, statistics, and their files."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.files import atomic_path
from furcl.image.colour import srgb_encode
from furcl.image.exr import read_exr, rgb_of, to_rec709_of, write_exr
from furcl.image.size import Window, strips
from furcl.values import shown

SUFFIXES = (".exr", ".png")
# Statistics that get a header attribute of their own; all of them are in the attribute
# `furcl:stats`.
HEADER_KEYS = (
    "version", "git", "scene", "seed", "spp", "sampling", "sequence", "device", "driver",
    "features", "denoised",
)  # fmt: skip
STATS_ATTRIBUTE = "furcl:stats"
EXPOSURE_ATTRIBUTE = "furcl:exposure_stops"


@dataclass(frozen=True, eq=False, repr=False)
class Image:
    """A picture of linear Rec.709 radiance; shows itself in a notebook.

    Attributes
    ----------
    rgb : (H, W, 3) float32         mean of the samples, row 0 on top
    variance : (H, W, 3) float32    variance of that mean (sample variance over spp), or None if
                                    unknown; with the sequence "sobol" an upper bound of it
    samples : (H, W) uint32         samples of each pixel, or None if unknown. EXR files have them
                                    where they differ, with the channel `error`, and A, 1 where
                                    there are any, where some pixels have none
    stats : dict                    what the render says about itself, JSON values
    exposure_stops : float          of PNG files and the notebook
    layers : dict                   channel by its EXR name -> (H, W) float32 (docs/layers.md)
    attributes : dict               of the EXR header, which belong to layers
    transparent : bool              rgb holds nothing of what is behind the scene: it is multiplied
                                    with the layer A
    window : Window or None         what part of a larger picture this is; EXR files have it as
                                    their data window
    """

    rgb: NDArray[np.float32]
    variance: NDArray[np.float32] | None = None
    stats: dict[str, Any] = field(default_factory=dict)
    exposure_stops: float = 0.0
    samples: NDArray[np.uint32] | None = None
    window: Window | None = None
    layers: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    transparent: bool = False

    def __post_init__(self) -> None:
        if self.rgb.ndim != 3 or self.rgb.shape[2] != 3 or 0 in self.rgb.shape:
            raise ImageError(f"rgb has the shape {self.rgb.shape}; expected (H, W, 3)")
        if self.variance is not None and self.variance.shape != self.rgb.shape:
            raise ImageError(
                f"variance has the shape {self.variance.shape}; expected that of rgb, "
                f"{self.rgb.shape}"
            )
        if self.samples is not None and self.samples.shape != self.rgb.shape[:2]:
            raise ImageError(
                f"samples has the shape {self.samples.shape}; expected {self.rgb.shape[:2]}, one "
                f"number a pixel"
            )
        size = (self.width, self.height)
        if self.window is not None and (self.window.width, self.window.height) != size:
            raise ImageError(f"{self.window} is not of the size of rgb, {size[0]} x {size[1]}")

    def __repr__(self) -> str:
        facts = [f"{self.width} x {self.height}"]
        if "scene" in self.stats:
            facts.append(repr(self.stats["scene"]))
        if "spp" in self.stats:
            facts.append(f"{self.stats['spp']} spp")
        if self.variance is not None:
            facts.append("with variance")
        return f"Image({', '.join(facts)})"

    @property
    def width(self) -> int:
        """Columns."""
        return self.rgb.shape[1]

    @property
    def height(self) -> int:
        """Rows."""
        return self.rgb.shape[0]

    @property
    def standard_error(self) -> NDArray[np.float32] | None:
        """Root of the variance, mean of the channels, (H, W); None if unknown."""
        if self.variance is None:
            return None
        out = np.empty(self.variance.shape[:2], np.float32)
        for rows in strips(self.height, self.width):
            out[rows] = np.sqrt(self.variance[rows].mean(axis=2, dtype=np.float64))
        return out

    @classmethod
    def load(cls, path: str | Path) -> Image:
        """Read a picture from an OpenEXR file with channels R, G, B (or Y).

        The variance is read where there is one, and so are the numbers of samples; statistics and
        exposure where furcl wrote the file.

        Raises
        ------
        ImageError      no such file, no OpenEXR file, damaged, or without the channels; and where
                        `chromaticities` that are not Rec.709 stand beside a variance (others are
                        converted)
        """
        channels, header = read_exr(path)
        names = [f"variance.{name}" for name in "RGB"]
        variance = None
        if all(name in channels for name in names):
            if to_rec709_of(header, path) is not None:
                raise ImageError(
                    f"{path}: carries a variance, and its chromaticities are not those of Rec.709; "
                    f"leave out the channels {', '.join(names)}, which cannot be converted"
                )
            variance = np.stack([channels[name] for name in names], axis=2)
        try:
            stats = json.loads(header.get(STATS_ATTRIBUTE, "{}"))
        except (TypeError, ValueError):
            raise ImageError(
                f"{path}: the header attribute {STATS_ATTRIBUTE} is not JSON; the file was edited, "
                f"save the picture again"
            ) from None
        samples = None
        if "samples" in channels:
            samples = _whole_numbers(channels["samples"], path)
        if samples is not None and variance is not None:
            variance[samples == 1] = np.nan
        stops = header.get(EXPOSURE_ATTRIBUTE, 0.0)
        if not (isinstance(stops, float) and math.isfinite(stops)):
            raise ImageError(
                f"{path}: the header attribute {EXPOSURE_ATTRIBUTE} is {shown(stops)}, no number; "
                f"the file was edited, save the picture again"
            )
        loaded = cls(
            rgb_of(channels, header, path),
            variance,
            stats,
            stops,
            samples,
            layers={name: channels[name] for name in stats.get("layers", ()) if name in channels},
            attributes={k: v for k, v in header.items() if k.startswith("cryptomatte/")},
            transparent=bool(stats.get("transparent", False)),
        )
        if "crop" not in stats:
            return loaded
        try:
            return loaded.cropped(*stats["crop"])
        except TypeError:
            raise ImageError(
                f"{path}: the header attribute {STATS_ATTRIBUTE} names no window by its crop = "
                f"{shown(stats['crop'])}; the file was edited, save the picture again"
            ) from None

    def cropped(self, left: int, top: int, right: int, bottom: int) -> Image:
        """A window of a whole picture, given as `film.crop` of a scene.

        Raises
        ------
        ImageError      the window is not within the picture
        """
        if not (0 <= left < right <= self.width and 0 <= top < bottom <= self.height):
            raise ImageError(
                f"the window {left}, {top} to {right}, {bottom} is not within the picture of "
                f"{self.width} x {self.height}"
            )

        def part(values: Any) -> Any:
            return None if values is None else values[top:bottom, left:right]

        return replace(
            self,
            rgb=part(self.rgb),
            variance=part(self.variance),
            samples=part(self.samples),
            layers={name: part(values) for name, values in self.layers.items()},
            window=Window(left, top, right - left, bottom - top, self.width, self.height),
        )

    def save(self, path: str | Path) -> None:
        """Write an .exr (float, with variance and header) or a .png (8 bit sRGB at
        `exposure_stops`).

        Where pixels have different numbers of samples, or fewer than two, the .exr has the layers
        `samples` and `error`, which is the standard error; else `spp` in the header says it all.
        Variance and error of fewer than two samples are written as 0, and left out if all are.

        The file appears whole or not at all; an older one of that name is kept until then.

        Raises
        ------
        ImageError      another suffix, or a folder that cannot be written to
        """
        path = Path(path)
        if path.suffix.lower() not in SUFFIXES:
            raise ImageError(
                f"{path}: the suffix {path.suffix!r} names no picture format; use "
                f"{' or '.join(SUFFIXES)}"
            )
        if not path.parent.is_dir():
            raise ImageError(f"{path}: the folder {path.parent} does not exist; create it first")
        try:
            with atomic_path(path) as temporary:
                if path.suffix.lower() == ".png":
                    with temporary.open("wb") as file:
                        self._write_png(file)
                else:
                    exposure = {EXPOSURE_ATTRIBUTE: float(self.exposure_stops)}
                    header = {**_header(self.stats), **exposure, **self.attributes}
                    write_exr(temporary, self._channels(), header, self.window)
        except OSError as error:
            raise ImageError(f"{path}: cannot be written: {error.strerror}") from None

    def png_bytes(self) -> bytes:
        """The picture as an 8 bit sRGB PNG file; values above 1 after exposure are cut."""
        stream = io.BytesIO()
        self._write_png(stream)
        return stream.getvalue()

    def _write_png(self, file: BinaryIO) -> None:
        from PIL import Image as PillowImage

        alpha = self.layers.get("A") if self.transparent else None
        encoded = np.empty((*self.rgb.shape[:2], 3 if alpha is None else 4), np.uint8)
        for rows in strips(self.height, self.width):
            linear = self.rgb[rows].astype(np.float64) * 2.0**self.exposure_stops
            if alpha is not None:  # PNG keeps the colours of what covers a part of a pixel
                linear /= np.maximum(alpha[rows], np.finfo(np.float32).tiny)[..., None]
                encoded[rows, :, 3] = np.rint(alpha[rows] * 255.0).astype(np.uint8)
            srgb = srgb_encode(np.clip(np.nan_to_num(linear, posinf=1.0), 0.0, 1.0))
            encoded[rows, :, :3] = np.rint(srgb * 255.0).astype(np.uint8)
        PillowImage.fromarray(encoded, "RGB" if alpha is None else "RGBA").save(file, "PNG")

    def _repr_png_(self) -> bytes:
        return self.png_bytes()

    def _channels(self) -> dict[str, NDArray[np.float32]]:
        """What files hold: no NaN, so 0 where the variance of a pixel is not known."""
        channels = {name: self.rgb[:, :, i] for i, name in enumerate("RGB")}
        errors: dict[str, NDArray[np.float32] | None] = {}
        if self.variance is not None:
            errors = {f"variance.{name}": self.variance[:, :, i] for i, name in enumerate("RGB")}
        counts = self.samples
        if counts is not None:
            fewest, most = counts.min(), counts.max()
            if fewest < 2 or fewest < most:
                channels["samples"] = counts.astype(np.float32)
                errors["error"] = self.standard_error
            if fewest == 0:
                channels["A"] = (counts > 0).astype(np.float32)
            if most < 2:
                errors = {}
            elif fewest < 2:
                errors = {name: _zero(values, counts < 2) for name, values in errors.items()}
        known = {name: values for name, values in errors.items() if values is not None}
        return {**channels, **known, **self.layers}


def _zero(
    values: NDArray[np.float32] | None, where: NDArray[np.bool_]
) -> NDArray[np.float32] | None:
    return None if values is None else np.where(where, np.float32(0.0), values)


def _whole_numbers(samples: NDArray[np.float32], path: str | Path) -> NDArray[np.uint32]:
    """The channel `samples` as uint32."""
    if not (samples.min() >= 0.0 and samples.max() < 2.0**32):
        raise ImageError(
            f"{path}: the channel samples goes from {samples.min()} to {samples.max()}; it holds "
            f"numbers of samples, 0 to 4294967295; leave it out, or save the picture again"
        )
    return samples.astype(np.uint32)


def _header(stats: Mapping[str, Any]) -> dict[str, Any]:
    header: dict[str, Any] = {STATS_ATTRIBUTE: json.dumps(stats, default=str, sort_keys=True)}
    for key in HEADER_KEYS:
        value = stats.get(key)
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            value = json.dumps(value, default=str, sort_keys=True)
        if isinstance(value, int) and not -(1 << 31) <= value < 1 << 31:
            value = str(value)
        if isinstance(value, float) and not math.isfinite(value):
            value = str(value)
        header[f"furcl:{key}"] = value
    return header
