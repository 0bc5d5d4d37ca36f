"""Pictures without noise, by Open Image Denoise: previews, whose error is not known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.image.image import Image

#: What a render needs so that the denoiser knows where fibres are.
LAYERS = ("albedo", "normal", "tangent")
NEEDED = "denoising needs Open Image Denoise; install it: pip install 'furcl[denoise]'"
BIASED = "biased, a preview"


def denoised(image: Image) -> Image:
    """The picture as a network of Open Image Denoise sees it without noise.

    It is guided by the layers `albedo`, and `tangent` (on fibres) and `normal` (elsewhere), where
    the picture has them. The result is biased, by an amount that nobody knows: it has no variance,
    says so in its statistics and header, and is refused where pictures are measured or merged.
    Layers are kept as they are. Values below 0, which filters with negative lobes make, count as 0.

    Raises
    ------
    ImageError      pyoidn is not installed or fails; a picture that is denoised already, or that
                    holds values that are not finite
    """
    try:
        import pyoidn
    except ImportError:
        raise ImageError(NEEDED) from None
    refuse_denoised(image, "the picture", "give the one it was made of")
    if not np.isfinite(image.rgb).all():
        raise ImageError("the picture holds values that are not finite; render it again")
    guides: dict[str, NDArray[np.float32]] = {}
    albedo = _three(image, "albedo", "RGB")
    if albedo is not None:
        guides["albedo"] = np.clip(np.nan_to_num(albedo), 0.0, 1.0)
        across = _direction(image)
        if across is not None:  # which the network takes beside an albedo alone
            guides["normal"] = across
    try:
        rgb = pyoidn.denoise(
            np.maximum(image.rgb, 0.0), guides.get("albedo"), guides.get("normal"), hdr=True
        )
    except (RuntimeError, OSError) as error:
        raise ImageError(f"Open Image Denoise fails: {error!s:.200}") from None
    said = f"by Open Image Denoise ({', '.join(guides) or 'colour alone'}): {BIASED}"
    return replace(
        image, rgb=rgb, variance=None, samples=None, stats={**image.stats, "denoised": said}
    )


def refuse_denoised(image: Image, what: str, remedy: str, error: Any = ImageError) -> None:
    """Refuse a denoised picture where numbers are taken from it."""
    if "denoised" in image.stats:
        raise error(f"{what}: is denoised, so biased, for previews alone; {remedy}")


def _three(image: Image, name: str, letters: str) -> NDArray[np.float32] | None:
    """The channels of a layer (H, W, 3), None where it lacks one."""
    channels = [image.layers.get(f"{name}.{letter}") for letter in letters]
    if any(channel is None for channel in channels):
        return None
    return np.stack([np.asarray(channel, np.float32) for channel in channels], axis=2)


def _direction(image: Image) -> NDArray[np.float32] | None:
    """Tangents where there are fibres, normals elsewhere; of a length up to 1."""
    tangent, normal = _three(image, "tangent", "XYZ"), _three(image, "N", "XYZ")
    if tangent is None or normal is None:
        found = normal if tangent is None else tangent
    else:
        found = np.where((tangent != 0.0).any(axis=2, keepdims=True), tangent, normal)
    return None if found is None else np.clip(np.nan_to_num(found), -1.0, 1.0)
