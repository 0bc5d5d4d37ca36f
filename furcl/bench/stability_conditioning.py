"""The float64 reference at the points of the stability sweep, and how far it moves when its inputs
move by what float32 rounds away."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_points import Points
from furcl.bench.stability_weights import Rows
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]

Neighbours = Callable[[Any, float], list[Any]]


def _reference(probe: Probe) -> Any:
    """The module of the float64 reference of a probe's model."""
    return import_module(probe.material.model.reference)


def reference_attenuation(probe: Probe, h: Array, theta: Array, fibre: Any = None) -> Array:
    """(lobes, n, 3) float64; of another fibre than the probe's if given."""
    lobes = _reference(probe).attenuation(
        fibre or probe.fibre, h, theta, probe.material.profiles, residual=True
    )
    return np.stack([lobes[name] for name in probe.lobes])


def reference_evaluate(
    probe: Probe, wo: Array, wi: Array, h: Array, lobe: int | None = None, fibre: Any = None
) -> Array:
    """(lobes, n, 3) float64, or (n, 3) of one lobe; of another fibre than the probe's if given."""
    evaluate, of = _reference(probe).evaluate, (fibre or probe.fibre, wo, wi, h)
    if lobe is not None:
        return evaluate(*of, probe.material.profiles, lobe=probe.lobes[lobe])
    return np.stack([evaluate(*of, probe.material.profiles, lobe=name) for name in probe.lobes])


def reference_pdf(
    probe: Probe, wo: Array, wi: Array, h: Array, lobe: int, fibre: Any = None
) -> Array:
    """(n, 1) float64 density of lobe, offset and direction.

    The density over lobe and offset is looked up in the tables.
    """
    direction = _reference(probe).direction_pdf(
        fibre or probe.fibre, wo, wi, h, probe.material.profiles,
        lobe=probe.lobes[lobe], sampling=probe.sampler.name,
    )  # fmt: skip
    assert probe.material.tables is not None
    # Per unit of h, which uniform h has a density of 1/2 of.
    joint = 0.5 * Rows(probe.material.tables, np.hypot(wo[:, 1], wo[:, 2])).joint(h)[lobe]
    return (joint * direction)[:, None]


def attenuation_conditioning(
    probe: Probe, neighbours: Neighbours, points: Points, at, p: int
) -> Array:
    """Change of the reference for one unit in the last place of h or of the cosine, and between
    `neighbours` of the fibre (`Subject.neighbours`)."""
    h, sin_cos = points.h[at], points.sin_cos[at]
    theta = points.theta[at]
    middle = reference_attenuation(probe, h, theta)[p]
    effect = np.zeros_like(middle)
    for way in (-1.0, 1.0):
        tilted = np.arctan2(sin_cos[:, 0], sin_cos[:, 1] * (1.0 + way * 2.0**-24))
        moved = _moved(h, way)
        for h_used, theta_used in ((moved, theta), (h, tilted)):
            other = reference_attenuation(probe, h_used, theta_used)[p]
            effect = np.maximum(effect, np.abs(other - middle))
        others = ((h, fibre) for fibre in neighbours(probe.fibre, way))
        for h_used, fibre in ((rescaled(h, way), None), *others):
            other = reference_attenuation(probe, h_used, theta, fibre)[p]
            effect = np.maximum(effect, np.abs(other - middle))
    return effect


def evaluate_conditioning(
    probe: Probe,
    neighbours: Neighbours,
    points: Points,
    at,
    p: int,
    reference: Callable[..., Array] = reference_evaluate,
) -> Array:
    """The same for h, every component of wo and wi, and an azimuth of up to 2 pi."""
    wo, wi, h = points.wo[at], points.wi[at], points.h[at]
    middle = reference(probe, wo, wi, h, p)
    effect = np.zeros_like(middle)
    for way in (-1.0, 1.0):
        others = [
            reference(probe, wo, wi, moved, p) for moved in (_moved(h, way), rescaled(h, way))
        ]
        others += [reference(probe, wo, wi, h, p, f) for f in neighbours(probe.fibre, way)]
        for axis in range(3):
            for which in range(2):
                pair = [wo.copy(), wi.copy()]
                pair[which][:, axis] = _moved(pair[which][:, axis], way)
                others.append(reference(probe, pair[0], pair[1], h, p))
        others += [reference(probe, wo, turned, h, p) for turned in nearby(wi)]
        for other in others:
            effect = np.fmax(effect, np.abs(other - middle))
    return effect


def pdf_conditioning(probe: Probe, neighbours: Neighbours, points: Points, at, p: int) -> Array:
    """The same of `reference_pdf`."""
    return evaluate_conditioning(probe, neighbours, points, at, p, reference_pdf)


def rescaled(h: Array, way: float) -> Array:
    """h moved by what four roundings to float32 may: the edge of the medulla is at |h'| = kappa
    with h' = h cos(theta) / n_t, and an edge of the tables at a whole number of bins."""
    return np.clip(h * (1.0 + way * 2.0**-22), -1.0, 1.0)


def nearby(wi: Array) -> list[Array]:
    """Directions that no float32 azimuth can tell from wi: turned about the fibre by two units in
    the last place of 2 pi, the azimuth being a sum. Bins of a profile that they fall into are wi's
    own as well."""
    out = []
    for turn, lift in itertools.product((-(2.0**-20), 2.0**-20), (-(2.0**-24), 2.0**-24)):
        x, y, z = wi.T
        out.append(np.stack([np.clip(x + lift, -1.0, 1.0), y - turn * z, z + turn * y], 1))
    return out


def _moved(x: Array, way: float) -> Array:
    """Float32 neighbours, at least 2^-25 away from x; inside [-1, 1]."""
    step = np.maximum(np.spacing(np.abs(x).astype(np.float32)).astype(np.float64), 2.0**-25)
    return np.clip(x + way * step, -1.0, 1.0)
