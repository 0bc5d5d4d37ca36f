"""The float64 reference at the points of the stability sweep, and how far it moves when its inputs
move by what float32 rounds away."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_points import Points
from furcl.bench.stability_weights import Rows
from furcl.fibre.double_cylinder import reference
from furcl.fibre.double_cylinder.layout import SCATTERED
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]


def reference_attenuation(
    probe: Probe, h: Array, theta: Array, fibre: Fibre | None = None
) -> Array:
    """(lobes, n, 3) float64; of another fibre than the probe's if given."""
    lobes = reference.attenuation(
        fibre or probe.fibre, h, theta, probe.material.profiles, residual=True
    )
    return np.stack([lobes[name] for name in probe.lobes])


def reference_evaluate(
    probe: Probe,
    wo: Array,
    wi: Array,
    h: Array,
    lobe: int | None = None,
    fibre: Fibre | None = None,
) -> Array:
    """(lobes, n, 3) float64, or (n, 3) of one lobe; of another fibre than the probe's if given."""
    profiles, of = probe.material.profiles, fibre or probe.fibre
    if lobe is not None:
        return reference.evaluate(of, wo, wi, h, profiles, lobe=probe.lobes[lobe])
    return np.stack([reference.evaluate(of, wo, wi, h, profiles, lobe=n) for n in probe.lobes])


def reference_pdf(
    probe: Probe, wo: Array, wi: Array, h: Array, lobe: int, fibre: Fibre | None = None
) -> Array:
    """(n, 1) float64 density of lobe, offset and direction; nan where no light takes the lobe.

    The density over lobe and offset is looked up in the tables; that over directions is the value
    of the lobe over its attenuation, both without absorption, which it does not depend on.
    """
    name = probe.lobes[lobe]
    clear, profiles = (fibre or probe.fibre).replace(sigma_ca=(0.0, 0.0, 0.0)), None
    if name in SCATTERED:
        profiles = _without_absorption(probe.material.profiles)
    else:
        clear = clear.replace(sigma_ma=(0.0, 0.0, 0.0), sigma_ms=0.0)
    cos = np.hypot(wo[:, 1], wo[:, 2])
    theta = np.arctan2(wo[:, 0], cos)
    share = reference.attenuation(clear, h, theta, profiles, residual=True)[name][..., 0]
    value = reference.evaluate(clear, wo, wi, h, profiles, lobe=name)[..., 0]
    direction = np.divide(value, share, out=np.full_like(value, np.nan), where=share > 1e-200)
    assert probe.material.tables is not None
    # Per unit of h, which uniform h has a density of 1/2 of.
    joint = 0.5 * Rows(probe.material.tables, cos).joint(h)[lobe]
    return (joint * direction)[:, None]


def _without_absorption(profiles: MedullaProfiles | None) -> MedullaProfiles | None:
    """The same densities of scattered directions, all of their light let out."""
    if profiles is None:
        return None
    azimuth = dataclasses.replace(profiles.azimuth, absorption=None)
    return dataclasses.replace(profiles, azimuth=azimuth, escape=None)


def attenuation_conditioning(probe: Probe, points: Points, at, p: int) -> Array:
    """Change of the reference for one unit in the last place of h, of the cosine or of kappa."""
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
        # Where the chord begins, h' against kappa: either moves with the other kept.
        kappa = float(rescaled(np.array(probe.fibre.kappa), way))
        for h_used, fibre in ((rescaled(h, way), None), (h, probe.fibre.replace(kappa=kappa))):
            other = reference_attenuation(probe, h_used, theta, fibre)[p]
            effect = np.maximum(effect, np.abs(other - middle))
    return effect


def evaluate_conditioning(
    probe: Probe, points: Points, at, p: int, reference: Callable[..., Array] = reference_evaluate
) -> Array:
    """The same for h, every component of wo and wi, and an azimuth of up to 2 pi."""
    wo, wi, h = points.wo[at], points.wi[at], points.h[at]
    middle = reference(probe, wo, wi, h, p)
    effect = np.zeros_like(middle)
    for way in (-1.0, 1.0):
        others = [
            reference(probe, wo, wi, moved, p) for moved in (_moved(h, way), rescaled(h, way))
        ]
        kappa = float(rescaled(np.array(probe.fibre.kappa), way))
        others.append(reference(probe, wo, wi, h, p, probe.fibre.replace(kappa=kappa)))
        for axis in range(3):
            for which in range(2):
                pair = [wo.copy(), wi.copy()]
                pair[which][:, axis] = _moved(pair[which][:, axis], way)
                others.append(reference(probe, pair[0], pair[1], h, p))
        others += [reference(probe, wo, turned, h, p) for turned in nearby(wi)]
        for other in others:
            effect = np.fmax(effect, np.abs(other - middle))
    return effect


def pdf_conditioning(probe: Probe, points: Points, at, p: int) -> Array:
    """The same of `reference_pdf`."""
    return evaluate_conditioning(probe, points, at, p, reference_pdf)


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
