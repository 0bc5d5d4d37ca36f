"""How far the double cylinder is from reciprocal, by lobe, and what a reciprocal form would cost.

python bench/reciprocity.py [-o FOLDER] [--presets raccoon] [--n 1000]

Light goes from a to b as it goes from b to a where S(a, b) = S(b, a), S being the scattering
function without the cosine. Pairs of directions are drawn as fibres of all orientations scatter
light: a evenly over the sphere with weight cos(theta), b by the lobe. Printed, and written to
FOLDER/reciprocity.json:

  apart    total variation distance between the pairs (a, b) and the pairs (b, a): the share of the
           light that would have to go elsewhere; 0 is reciprocal, 1 has nothing in common
  cost     with A_p and theta_t of the half difference angle, (theta_b - theta_a) / 2, for R, TT and
           TRT: what the energy of the lobe becomes, and the relative variance of the weights, since
           the lobe and h are drawn before theta_b is known

All in float64, by the reference (furcl.fibre.double_cylinder.reference).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tables import FOLDER

from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles, build_profiles
from furcl.fibre.double_cylinder.reference.model import evaluate
from furcl.fibre.double_cylinder.reference.optics import LOBES, SCATTERED, attenuation
from furcl.fibre.double_cylinder.reference.profiles import UNSCATTERED
from furcl.fibre.double_cylinder.reference.sampling import sample

Array = NDArray[np.float64]

PRESETS = ("human-white", "human-black", "raccoon", "red-fox")
N_PAIRS = 20_000
# Fewer pairs of a lobe say nothing of it; more are not needed.
FEWEST, MOST = 200, 4000
# Offsets of a far-field mean, and pairs that are worked on together.
N_OFFSETS, CHUNK = 256, 500
# Inclinations of a; the sampler makes tables for each.
N_INCLINATIONS = 40


def inclinations() -> Array:
    """Midpoints in the distribution of cos^2(theta), that of visible fibres of all orientations."""
    theta = np.linspace(0.0, np.pi / 2, 20001)
    distribution = (theta + 0.5 * np.sin(2.0 * theta)) / (np.pi / 2)
    return np.interp((np.arange(N_INCLINATIONS) + 0.5) / N_INCLINATIONS, distribution, theta)


def values(fibre: Fibre, a: Array, b: Array, lobe: str | None, profiles: Any) -> Array:
    """Far-field values (n,) of pairs of directions, a known: mean over h and channels."""
    h = np.sin(np.pi * ((np.arange(N_OFFSETS) + 0.5) / N_OFFSETS - 0.5))
    weight = np.cos(np.arcsin(h))
    weight /= weight.sum()
    found = []
    for first in range(0, len(a), CHUNK):
        part = slice(first, first + CHUNK)
        each = evaluate(fibre, a[part, None], b[part, None], h, profiles, lobe)
        found.append(each.mean(axis=2) @ weight)
    return np.concatenate(found)


def cosine(w: Array) -> Array:
    """Of the inclination."""
    return np.hypot(w[:, 1], w[:, 2])


def apart(
    fibre: Fibre, a: Array, b: Array, weight: Array, lobe: str | None, profiles: Any
) -> float:
    """The distance, by pairs that were drawn from S(a, b) with weights."""
    there = values(fibre, a, b, lobe, profiles) * cosine(a)
    back = values(fibre, b, a, lobe, profiles) * cosine(b)
    ratio = np.divide(back, there, out=np.zeros_like(back), where=there > 0.0)
    return float((weight * np.maximum(1.0 - ratio, 0.0)).sum() / weight.sum())


def cost(
    fibre: Fibre, a: Array, b: Array, h: Array, weight: Array, lobe: str
) -> tuple[float, float]:
    """Energy of a lobe of the half difference angle over its own, and variance of its weights."""
    theta_a, theta_b = (np.arctan2(w[:, 0], cosine(w)) for w in (a, b))
    own = attenuation(fibre, h, theta_a, UNSCATTERED)[lobe].mean(axis=1)
    half = 0.5 * (theta_b - theta_a)
    other = attenuation(fibre, h, half, UNSCATTERED)[lobe].mean(axis=1)
    ratio = np.divide(other, own, out=np.zeros_like(own), where=own > 0.0)
    mean = (weight * ratio).sum() / weight.sum()
    square = (weight * ratio**2).sum() / weight.sum()
    return float(mean), float(square / mean**2 - 1.0)


def pairs(fibre: Fibre, profiles: MedullaProfiles | None, n: int, seed: int) -> tuple[Array, Any]:
    """Directions a (n, 3), both ways along the fibre, and what `sample` drew for them."""
    rng = np.random.default_rng(seed)
    theta = np.resize(np.concatenate([inclinations(), -inclinations()]), n)
    a = np.stack([np.sin(theta), np.cos(theta), np.zeros(n)], axis=1)
    return a, sample(fibre, a, profiles=profiles, sampling="full-cdf", rng=rng)


def measure(
    fibre: Fibre, profiles: MedullaProfiles | None, n: int, seed: int = 1
) -> dict[str, Any]:
    """`apart` of the whole and of every lobe, and `cost` of the lobes that are not scattered."""
    a, drawn = pairs(fibre, profiles, n, seed)
    weight = drawn.weight.mean(axis=1)
    few = slice(0, MOST)
    whole = apart(fibre, a[few], drawn.wi[few], weight[few], None, profiles)
    found: dict[str, Any] = {"all": {"share": 1.0, "apart": whole}}
    for number, lobe in enumerate(LOBES):
        mine = np.flatnonzero(drawn.lobe == number)[:MOST]
        share = float(weight[drawn.lobe == number].sum() / weight.sum())
        if len(mine) < FEWEST:
            continue
        w = weight[mine]
        row = {"share": share, "apart": apart(fibre, a[mine], drawn.wi[mine], w, lobe, profiles)}
        if lobe not in SCATTERED:
            energy, variance = cost(fibre, a[mine], drawn.wi[mine], drawn.h[mine], w, lobe)
            row |= {"energy": energy, "variance": variance}
        found[lobe] = row
    return found


def run(device: Device, presets: list[str], n: int) -> dict[str, Any]:
    """All presets."""
    found = {}
    for name in presets:
        fibre = Fibre.preset(name)
        found[name] = measure(fibre, build_profiles(device, fibre), n)
        for lobe, row in found[name].items():
            print(f"{name:>12} {lobe:>5} " + " ".join(f"{k} {v:.4g}" for k, v in row.items()))
    return {**circumstances(device), "pairs": n, "presets": found}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=FOLDER)
    parser.add_argument("--presets", nargs="+", default=PRESETS)
    parser.add_argument("--n", type=int, default=N_PAIRS)
    parser.add_argument("--device", default=None)
    options = parser.parse_args()
    results = run(open_device(options.device), options.presets, options.n)
    write_json(results, options.output / "reciprocity.json")


if __name__ == "__main__":
    main()
