"""Model against truth for one smooth fibre: energies by path and where scattered light goes.

    python bench/fibre_truth.py [-o bench/results] [--presets NAME ...] [--theta DEG ...]
                                [--photons N] [--seed N] [--device TEXT]

Truth is the Monte Carlo of fibre_walk.py. Both sides have a plain interface (layers = 1/2) and no
tilt; the model's roughness does not enter the energies. Its scattered lobes use the medulla's
simulated profiles. R, TT and TRT must agree; for the scattered lobes the differences are the
result: the model lets scattered light out without refraction, without reflection at the cuticle and
through a radial stretch of cortex.

Writes fibre_truth.json into the folder given by -o, of which docs_tables.py makes the table of
docs/model.md.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from fibre_walk import CLASSES, PHI_BINS, S_BINS, Truth, simulate

from furcl import bcsdf
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles, build_profiles

PRESETS = ("human-white", "human-black", "raccoon", "red-fox", "unlabelled-a", "unlabelled-b")
SCATTERED = slice(4, 7)


def model_density(fibre: Fibre, theta: float, profiles: MedullaProfiles | None) -> np.ndarray:
    """The model's scattered light (S_BINS, PHI_BINS): far field, mean of the channels."""
    s = (np.arange(2 * S_BINS) + 0.5) / S_BINS - 1
    phi = ((np.arange(2 * PHI_BINS) + 0.5) / PHI_BINS - 1) * np.pi
    grid_s, grid_phi = np.meshgrid(s, phi, indexing="ij")
    c = np.sqrt(1 - grid_s**2)
    wi = np.stack([grid_s, c * np.cos(grid_phi), c * np.sin(grid_phi)], -1)
    wo = np.array([np.sin(theta), np.cos(theta), 0.0])
    total = np.zeros(grid_s.shape)
    h = (np.arange(80) + 0.5) / 40 - 1
    for offset in h:
        for lobe in ("TTs", "TRTs"):
            value = bcsdf.evaluate(fibre, wo, wi, offset, profiles, lobe=lobe)
            total += value.mean(-1) / h.size
    return total.reshape(S_BINS, 2, PHI_BINS, 2).mean((1, 3))


def _shape(density: np.ndarray) -> dict[str, float]:
    """Where scattered light goes: share on the far side (|phi| > pi/2), mean of s."""
    share = density / density.sum()
    phi = ((np.arange(PHI_BINS) + 0.5) / PHI_BINS * 2 - 1) * np.pi
    s = (np.arange(S_BINS) + 0.5) / S_BINS * 2 - 1
    return {
        "forward": float(share[:, np.abs(phi) > np.pi / 2].sum()),
        "mean_s": float(share.sum(1) @ s),
    }


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Half the sum of absolute differences of two densities scaled to sum 1: 0 same, 1 disjoint."""
    return float(0.5 * np.abs(a / a.sum() - b / b.sum()).sum())


def compare(
    fibre: Fibre, degrees: float, photons: int, seed: int, profiles: MedullaProfiles | None
) -> dict:
    """Energies (mean of the channels) and shapes of model and truth at one inclination."""
    theta = np.radians(degrees)
    truth = simulate(fibre, theta, photons, seed)
    model = bcsdf.lobe_albedos(fibre, theta, profiles, residual=True)
    energy = {name: float(truth.energy[k].mean()) for k, name in enumerate(CLASSES)}
    direct = {name: float(truth.direct[k].mean()) for k, name in enumerate(CLASSES)}
    lobes = {name: float(a.mean()) for name, a in model.items()}
    return {
        "theta_deg": degrees,
        "truth": energy,
        "truth_error": {name: float(truth.error[k].mean()) for k, name in enumerate(CLASSES)},
        "truth_direct": {name: direct[name] for name in CLASSES[SCATTERED]},
        "truth_albedo": sum(energy[name] for name in CLASSES if name != "trapped"),
        "model": lobes,
        "model_albedo": sum(lobes.values()),
        "unscattered_worst": _worst_unscattered(truth, model),
        "shape": _compare_shapes(truth.density[SCATTERED].sum(0), fibre, theta, profiles),
    }


def _worst_unscattered(truth: Truth, model: dict[str, np.ndarray]) -> float:
    """Largest relative difference of R, TT and TRT over the channels, of lobes above 1e-6."""
    pairs = [(truth.energy[k], model[name]) for k, name in enumerate(("R", "TT", "TRT"))]
    return max(float(np.max(np.where(m > 1e-6, np.abs(t / m - 1), 0.0))) for t, m in pairs)


def _compare_shapes(
    density: np.ndarray, fibre: Fibre, theta: float, profiles: MedullaProfiles | None
) -> dict:
    found = model_density(fibre, theta, profiles)
    return {
        "truth": _shape(density),
        "model": _shape(found),
        "distance": distance(density, found),
        "distance_phi": distance(density.sum(0), found.sum(0)),
        "distance_s": distance(density.sum(1), found.sum(1)),
    }


def main() -> None:
    """Run the comparison and write its results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--presets", nargs="+", default=PRESETS, metavar="NAME")
    parser.add_argument("--theta", nargs="+", type=float, default=(0, 30, 60), metavar="DEG")
    parser.add_argument("--photons", type=int, default=200_000, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument("--device", default="", help="as for furcl render")
    options = parser.parse_args()
    device = open_device(options.device or None)
    started = time.perf_counter()
    results: dict[str, list[dict]] = {}
    for name in options.presets:
        fibre = Fibre.preset(name, layers=0.5, alpha_deg=0.0)
        profiles = build_profiles(device, fibre)
        results[name] = [
            compare(fibre, degrees, options.photons, options.seed, profiles)
            for degrees in options.theta
        ]
        print(f"{name}: {time.perf_counter() - started:.0f} s", file=sys.stderr)
    record = {
        **circumstances(device),
        "photons": options.photons,
        "seed": options.seed,
        "classes": CLASSES,
        "results": results,
    }
    write_json(record, options.output / "fibre_truth.json")


if __name__ == "__main__":
    main()
