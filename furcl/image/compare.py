"""Distances between pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.device.layout import RELATIVE_EPSILON
from furcl.errors import ImageError
from furcl.image.colour import luminance
from furcl.image.image import Image

REL_EPSILON = RELATIVE_EPSILON
# The value that HDR-FLIP's tone map shows at 0.85 of white.
FLIP_WHITE = 2.119


@dataclass(frozen=True)
class Difference:
    """The largest absolute difference of any channel: where and between which values."""

    value: float
    column: int
    row: int
    channel: str
    test: float
    reference: float


def rmse(test: ArrayLike, reference: ArrayLike) -> float:
    """Root of the mean squared difference over pixels and channels, of linear radiance.

    Raises
    ------
    ImageError      pictures of different shapes, or values that are not finite
    """
    a, b = _pair(test, reference)
    return float(np.sqrt(np.mean((a - b) ** 2)))


def relmse(test: ArrayLike, reference: ArrayLike, epsilon: float = REL_EPSILON) -> float:
    """Mean over pixels and channels of (test - reference)^2 / (reference^2 + epsilon), epsilon
    0.01.

    The definition of Rousselle et al. 2011 with their epsilon; ImageError as `rmse`.
    """
    a, b = _pair(test, reference)
    return float(np.mean((a - b) ** 2 / (b**2 + epsilon)))


def flip(test: ArrayLike, reference: ArrayLike) -> float:
    """Mean HDR-FLIP error, 0 (equal) to 1, at 67 pixels a degree (Andersson et al. 2021).

    Exposures run from the one that shows the reference's brightest pixel to the one that shows the
    median of its lit pixels; black pixels take no part, as a black background would ask for an
    exposure without bound. Negative values count as 0.

    Raises
    ------
    ImageError      as `rmse`, or if the package flip-evaluator is not installed
    """
    a, b = (np.maximum(x, 0.0) for x in _pair(test, reference))
    try:
        import flip_evaluator
    except ImportError:
        raise ImageError(
            "FLIP needs the package flip-evaluator; install it with pip install 'furcl[report]'"
        ) from None
    values = luminance(b if b.any() else a)
    lit = values[values > 0.0]
    if not lit.size:
        return 0.0
    start = float(np.log2(FLIP_WHITE / lit.max()))
    stop = max(float(np.log2(FLIP_WHITE / np.median(lit))), start + 0.01)
    parameters = {"startExposure": start, "stopExposure": stop}
    b, a = (np.ascontiguousarray(x, np.float32) for x in (b, a))
    return float(flip_evaluator.evaluate(b, a, "HDR", parameters=parameters)[1])


def largest_difference(test: ArrayLike, reference: ArrayLike) -> Difference:
    """Where the pictures differ most; ImageError as `rmse`."""
    a, b = _pair(test, reference)
    row, column, channel = (int(i) for i in np.unravel_index(np.argmax(np.abs(a - b)), a.shape))
    x, y = float(a[row, column, channel]), float(b[row, column, channel])
    return Difference(abs(x - y), column, row, "RGB"[channel], x, y)


@dataclass(frozen=True)
class ZScores:
    """Differences of two independent renders over their standard errors.

    Attributes
    ----------
    n : int                 channel values with a variance above 0 and finite; the others are left
                            out
    mean : float            of z; its standard error is about 1 / sqrt(n) for renders of one truth
    rms : float             of z, about 1
    share_above_3 : float   part with |z| > 3, about 0.003
    whole : float           z of the whole picture's mean, its error taken from the differences of
                            the pixels: it needs no variance, only pixels that do not depend on each
                            other
    at_most : bool          the variances are upper bounds, as samples of a pixel depend on each
                            other (sequence "sobol"): mean, rms and share_above_3 come out too
                            small, and a difference that only they could show may hide; `whole`
                            does not use them
    """

    n: int
    mean: float
    rms: float
    share_above_3: float
    whole: float
    at_most: bool


def z_scores(test: Image, reference: Image) -> ZScores:
    """Compare two renders, with seeds of their own, by the variances that they carry.

    Raises
    ------
    ImageError      as `rmse`, or if both lack a variance
    """
    a, b = _pair(test.rgb, reference.rgb)
    if test.variance is None and reference.variance is None:
        raise ImageError(
            "neither picture carries a variance; compare .exr files that furcl rendered"
        )
    parts = [
        np.asarray(i.variance, np.float64) for i in (test, reference) if i.variance is not None
    ]
    variance = np.sum(parts, axis=0)
    known = (variance > 0.0) & np.isfinite(variance)
    z = (a - b)[known] / np.sqrt(variance[known])
    of_pixels = (a - b).mean(axis=2)
    spread = float(np.sqrt(np.sum(of_pixels**2)))
    return ZScores(
        n=int(z.size),
        mean=float(z.mean()) if z.size else 0.0,
        rms=float(np.sqrt(np.mean(z**2))) if z.size else 0.0,
        share_above_3=float(np.mean(np.abs(z) > 3.0)) if z.size else 0.0,
        whole=float(of_pixels.sum()) / spread if spread > 0.0 else 0.0,
        at_most=any(image.stats.get("sequence") == "sobol" for image in (test, reference)),
    )


def compare(test: Image, reference: Image) -> dict[str, Any]:
    """All distances at once: rmse, relmse, flip, largest, and z where variances are known."""
    largest = largest_difference(test.rgb, reference.rgb)
    result: dict[str, Any] = {
        "rmse": rmse(test.rgb, reference.rgb),
        "relmse": relmse(test.rgb, reference.rgb),
        "flip": flip(test.rgb, reference.rgb),
        "largest": vars(largest),
    }
    if test.variance is not None or reference.variance is not None:
        result["z"] = vars(z_scores(test, reference))
    return result


def _pair(test: ArrayLike, reference: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    a, b = np.asarray(test, np.float64), np.asarray(reference, np.float64)
    if a.shape != b.shape or a.ndim != 3 or a.shape[2] != 3:
        raise ImageError(
            f"the pictures have the shapes {a.shape} and {b.shape}; two (H, W, 3) of one size "
            f"can be compared: render both with the same --size"
        )
    for name, x in (("first", a), ("second", b)):
        if not np.isfinite(x).all():
            row, column = (int(i) for i in np.argwhere(~np.isfinite(x))[0][:2])
            raise ImageError(
                f"the {name} picture is {x[row, column].tolist()} in column {column}, row {row}; "
                f"only finite pictures can be compared"
            )
    return a, b
