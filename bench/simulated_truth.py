"""Simulated scattering against brute force of the same fibre: albedo and directions.

    python bench/simulated_truth.py [-o bench/results] [--presets NAME ...] [--theta DEG ...]
                                    [--photons N] [--seed N] [--device TEXT]

Truth is the Monte Carlo of fibre_walk.py; fibres have their layers and no tilt. Distances are of
the light that was scattered on the first two crossings, far field, in the bins of fibre_walk.py,
which are folded at phi = 0: half the sum of absolute differences. The noise of the truth is in
them; it is half the distance of the two halves of its photons.

The furnace is scenes/furnace.toml with the preset made white, without `render.residual`: light of
the fibres over the part of the picture that they cover, which is 1 if they lose nothing.

Writes simulated_truth.json into the folder given by -o.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from fibre_truth import PRESETS, distance
from fibre_walk import CLASSES, PHI_BINS, S_BINS, simulate

from furcl import bcsdf
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import build_profiles
from furcl.fibre.double_cylinder.simulated import build_simulated
from furcl.rendering.renderer import render
from furcl.scene.read import load_scene

OFFSETS = 96
FURNACES, FURNACE_SPP, FURNACE_SIZE = 8, 32, "128x128"
FIRST_TWO = slice(4, 6)


def folded(light: np.ndarray) -> np.ndarray:
    """(s, phi) as (s, |phi|): the far field is even in phi."""
    return light[:, PHI_BINS // 2 :] + light[:, PHI_BINS // 2 - 1 :: -1]


def density(fibre: Fibre, theta: float, tables: object) -> np.ndarray:
    """Light of TTs and TRTs (s, |phi|), mean of the channels; h at even places of its angle."""
    s = (np.arange(2 * S_BINS) + 0.5) / S_BINS - 1
    phi = ((np.arange(2 * PHI_BINS) + 0.5) / PHI_BINS - 1) * np.pi
    grid_s, grid_phi = np.meshgrid(s, phi, indexing="ij")
    c = np.sqrt(1 - grid_s**2)
    wi = np.stack([grid_s, c * np.cos(grid_phi), c * np.sin(grid_phi)], -1)
    wo = np.array([np.sin(theta), np.cos(theta), 0.0])
    total = np.zeros(grid_s.shape)
    # Twice over |h|, folded: the other side is the mirror image.
    for part in (np.arange(OFFSETS) + 0.5) / OFFSETS * np.pi / 2:
        for lobe in bcsdf.SCATTERED:
            value = bcsdf.evaluate(fibre, wo, wi, np.sin(part), tables, lobe=lobe)
            total += value.mean(-1) * np.cos(part) * np.pi / 2 / OFFSETS
    return folded(total.reshape(S_BINS, 2, PHI_BINS, 2).mean((1, 3)))


def compare(fibre: Fibre, degrees: float, photons: int, seed: int, tables: dict) -> dict:
    """Energies (mean of the channels) and distances at one inclination."""
    theta = np.radians(degrees)
    halves = [simulate(fibre, theta, photons // 2, 2 * seed + i) for i in range(2)]
    energy = np.mean([half.energy for half in halves], axis=0)
    error = np.linalg.norm([half.error for half in halves], axis=0) / 2
    found = [folded(half.density[FIRST_TWO].sum(0)) for half in halves]
    row = {
        "theta_deg": degrees,
        "truth_albedo": float(energy[: CLASSES.index("trapped")].sum(0).mean()),
        "truth_error": float(np.linalg.norm(error[4:7].mean(-1))),
        "noise": distance(*found) / 2,
    }
    for scattering, prepared in tables.items():
        one = fibre.replace(scattering=scattering)
        row[scattering] = {
            "albedo": float(bcsdf.albedo(one, theta, prepared, residual=True).mean()),
            "distance": distance(np.mean(found, axis=0), density(one, theta, prepared)),
        }
    return row


def built(device: Device, fibre: Fibre) -> tuple[dict, dict]:
    """What both ways look up, and what it took to make the tables, compiled before."""
    simulated = fibre.replace(scattering="simulated")
    build_simulated(device, simulated, photons=16, cache=False)
    start, busy = time.perf_counter(), time.process_time()
    tables = build_simulated(device, simulated, cache=False)
    assert tables is not None
    took = {
        "seconds": time.perf_counter() - start,
        "processor_seconds": time.process_time() - busy,
        "bytes": tables.pack().nbytes,
        "photons": tables.photons,
        "relative_error": tables.relative_error,
        "given_up": tables.given_up,
    }
    return {"model": build_profiles(device, fibre), "simulated": tables}, took


def furnace(device: Device, name: str, scattering: str) -> dict:
    """Light over covered part of a white furnace: mean and standard error of some renders."""
    settings = [
        f"fibre.preset={name}",
        f"fibre.scattering={scattering}",
        "render.residual=false",
        "render.roulette=depth",
        "render.roulette_depth=1000",
        "render.max_depth=1000",
        "film.background=transparent",
    ]
    scene = load_scene("furnace", overrides=settings, size=FURNACE_SIZE, spp=FURNACE_SPP)
    found = []
    for seed in range(FURNACES):
        image = render(scene, device=device, seed=seed)
        covered = image.layers["A"].mean(dtype=np.float64)
        found.append(image.rgb.mean(dtype=np.float64) / covered)
    return {"mean": float(np.mean(found)), "error": float(np.std(found, ddof=1) / FURNACES**0.5)}


def main() -> None:
    """Run the comparison and write its results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--presets", nargs="+", default=PRESETS, metavar="NAME")
    parser.add_argument("--theta", nargs="+", type=float, default=(0, 30, 60, 80), metavar="DEG")
    parser.add_argument("--photons", type=int, default=1_000_000, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument("--device", default="", help="as for furcl render")
    options = parser.parse_args()
    device = open_device(options.device or None)
    results = {}
    for name in options.presets:
        fibre = Fibre.preset(name, alpha_deg=0.0)
        tables, took = built(device, fibre)
        rows = [
            compare(fibre, degrees, options.photons, options.seed, tables)
            for degrees in options.theta
        ]
        white = {scattering: furnace(device, name, scattering) for scattering in tables}
        results[name] = {"tables": took, "rows": rows, "furnace": white}
        print(f"{name}: {results[name]}", file=sys.stderr)
        record = {
            **circumstances(device),
            "photons": options.photons,
            "seed": options.seed,
            "results": results,
        }
        write_json(record, options.output / "simulated_truth.json")


if __name__ == "__main__":
    main()
