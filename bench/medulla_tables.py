"""Time, size and noise of the medulla profiles of presets, and the lobe shares that they give.

    python bench/medulla_tables.py [-o bench/results] [--device D] [--plot DIR] [PRESET...]

Cold is the first call in a fresh process with empty caches (furcl's and PoCL's), kernel compilation
included; warm the first call in another process with furcl's cache filled. Writes
medulla_tables.json into the folder given by -o.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from furcl import bcsdf
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles, build_profiles

PRESETS = ("human-white", "human-black", "raccoon", "red-fox", "unlabelled-a", "unlabelled-b")


def measure(device: Device, preset: str) -> dict:
    """One call of `build_profiles` and what it gave."""
    fibre = Fibre.preset(preset)
    wall, cpu = time.perf_counter(), time.process_time()
    profiles = build_profiles(device, fibre)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    assert profiles is not None
    return {
        "wall_s": round(wall, 3),
        "cpu_s": round(cpu, 3),
        "kilobytes": profiles.pack().nbytes / 1000,
        "photons": profiles.photons,
        "largest_relative_error": round(profiles.relative_error, 5),
        "given_up": profiles.given_up,
        "lobe_shares": bcsdf.lobe_shares(fibre, profiles),
    }


def in_fresh_process(preset: str, device: str, folder: str) -> dict:
    """`measure` in a process whose caches are in `folder`."""
    environment = {
        **os.environ,
        "FURCL_CACHE_DIR": f"{folder}/furcl",
        "POCL_CACHE_DIR": f"{folder}/pocl",
    }
    command = [sys.executable, __file__, "--device", device, "--only", preset]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def plot(profiles: MedullaProfiles, preset: str, folder: Path) -> None:
    """Draw Dhat over phi and h, and the longitudinal profiles."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 2, figsize=(12, 8))
    phi = np.degrees(-np.pi + (np.arange(128) + 0.5) * np.pi / 64)
    s = -1 + (np.arange(64) + 0.5) / 32
    for tau_node, axis in ((0, axes[0, 0]), (3, axes[0, 1])):
        for node in (0, 8, 16, 24, 28, 31):
            h = np.sin(node / 31 * np.pi / 2)
            axis.semilogy(phi, profiles.azimuth.density[tau_node, node], label=f"h = {h:.3f}")
        axis.set(title=f"{preset}: Dhat, tau node {tau_node}", xlabel="phi [deg]", ylabel="1/rad")
        axis.legend()
    for band, axis in enumerate(axes[1]):
        for node in (0, 4, 8, 12, 14, 15):
            label = f"theta_i = {node * 6} deg"
            axis.semilogy(s, profiles.longitudinal.density[node, band], label=label)
        axis.set(title=f"{preset}: {('back', 'front')[band]}", xlabel="s", ylabel="density in s")
        axis.legend()
    figure.tight_layout()
    figure.savefig(folder / f"medulla_{preset}.png", dpi=80)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("presets", nargs="*", default=PRESETS)
    parser.add_argument("--device", default="")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--plot", type=Path, help="folder for PNG files")
    parser.add_argument("--only", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    device = open_device(arguments.device or None)
    if arguments.only:
        print(json.dumps(measure(device, arguments.only)))
        return
    record = {
        **circumstances(device),
        "load_average": os.getloadavg()[0],
        "presets": {},
    }
    for preset in arguments.presets:
        with tempfile.TemporaryDirectory() as folder:
            cold = in_fresh_process(preset, arguments.device, folder)
            warm = in_fresh_process(preset, arguments.device, folder)
        record["presets"][preset] = {**cold, "warm_wall_s": warm["wall_s"]}
        print(preset, record["presets"][preset])
        if arguments.plot:
            profiles = build_profiles(device, Fibre.preset(preset))
            assert profiles is not None
            plot(profiles, preset, arguments.plot)
    write_json(record, arguments.output / "medulla_tables.json")


if __name__ == "__main__":
    main()
