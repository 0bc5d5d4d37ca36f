"""Rendered pictures: mean, variance of the mean, statistics, and their files."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.files import atomic_path
from furcl.image.colour import srgb_encode
from furcl.image.exr import read_exr, rgb_of, to_rec709_of, write_exr
from furcl.image.size import Window
from furcl.values import shown

SUFFIXES = (".exr", ".png")
# Statistics that get a header attribute of their own; all of them are in the attribute
# `furcl:stats`.
HEADER_KEYS = (
    "version", "git", "scene", "seed", "spp", "sampling", "sequence", "device", "driver",
    "features",
)  # fmt: skip
STATS_ATTRIBUTE = "furcl:stats"


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
        return np.sqrt(self.variance.mean(axis=2, dtype=np.float64)).astype(np.float32)

    @classmethod
    def load(cls, path: str | Path) -> Image:
        """Read a picture from an OpenEXR file with channels R, G, B (or Y).

        The variance is read where there is one, and so are the numbers of samples, and the
        statistics where furcl wrote the file.

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
        samples = channels["samples"].astype(np.uint32) if "samples" in channels else None
        loaded = cls(
            rgb_of(channels, header, path),
            variance,
            stats,
            samples=samples,
            layers={name: channels[name] for name in stats.get("layers", ()) if name in channels},
            attributes={k: v for k, v in header.items() if k.startswith("cryptomatte/")},
            transparent=bool(stats.get("transparent", False)),
        )
        if not isinstance(stats, dict) or "crop" not in stats:
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

        Where pixels have different numbers of samples, the .exr has the layers `samples` and
        `error`, which is the standard error; else `spp` in the header says it all.

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
                    temporary.write_bytes(self.png_bytes())
                else:
                    header = {**_header(self.stats), **self.attributes}
                    write_exr(temporary, self._channels(), header, self.window)
        except OSError as error:
            raise ImageError(f"{path}: cannot be written: {error.strerror}") from None

    def png_bytes(self) -> bytes:
        """The picture as an 8 bit sRGB PNG file; values above 1 after exposure are cut."""
        from PIL import Image as PillowImage

        linear = self.rgb.astype(np.float64) * 2.0**self.exposure_stops
        alpha = self.layers.get("A") if self.transparent else None
        if alpha is not None:  # PNG keeps colours as they are without what is behind
            linear /= np.maximum(alpha, np.finfo(np.float32).tiny)[..., None]
        encoded = srgb_encode(np.clip(np.nan_to_num(linear, posinf=1.0), 0.0, 1.0))
        if alpha is not None:
            encoded = np.concatenate([encoded, alpha[..., None]], axis=2)
        stream = io.BytesIO()
        mode = "RGB" if alpha is None else "RGBA"
        PillowImage.fromarray(np.rint(encoded * 255.0).astype(np.uint8), mode).save(stream, "PNG")
        return stream.getvalue()

    def _repr_png_(self) -> bytes:
        return self.png_bytes()

    def _channels(self) -> dict[str, NDArray[np.float32]]:
        channels = {name: self.rgb[:, :, i] for i, name in enumerate("RGB")}
        if self.variance is not None:
            channels |= {f"variance.{name}": self.variance[:, :, i] for i, name in enumerate("RGB")}
        fewest, most = (0, 0) if self.samples is None else (self.samples.min(), self.samples.max())
        if self.samples is not None and (fewest == 0 or fewest < most):
            channels["samples"] = self.samples.astype(np.float32)
            if self.standard_error is not None:
                channels["error"] = self.standard_error
        if self.samples is not None and fewest == 0:
            channels["A"] = (self.samples > 0).astype(np.float32)
        return {**channels, **self.layers}


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
