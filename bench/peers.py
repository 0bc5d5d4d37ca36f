"""Render the grooms that other renderers were measured on, and write paths and rays a second.

python bench/peers.py FOLDER -o bench/results/peers/pocl [--device D] [--spp 256]

FOLDER holds hair10k.npz and fur100k.npz, each with points, radii, offsets and `scene`, a JSON text
with camera, environment, scalp and fibre. furcl needs neither the folder nor the grooms elsewhere.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.record import circumstances, write_json
from furcl.bench.stages import measure
from furcl.device.choice import open_device
from furcl.scene.read import decode_scene
from furcl.scene.tables import Scene

GROOMS = ("hair10k", "fur100k")

# Light found by fibres alone, and by a light sample at every vertex as well: the peers' way.
LIGHT_SAMPLING = ("bcsdf", "mis")


def longitudinal_deg(beta_m: float) -> float:
    """Standard deviation of R [deg] of the roughness beta_m (Chiang et al. 2016, equation 7)."""
    return float(np.rad2deg(0.726 * beta_m + 0.812 * beta_m**2 + 3.7 * beta_m**20))


def azimuthal_deg(beta_n: float) -> float:
    """Standard deviation [deg] of the logistic of beta_n (Chiang et al. 2016, equation 8)."""
    scale = np.sqrt(np.pi / 8) * (0.265 * beta_n + 1.194 * beta_n**2 + 5.372 * beta_n**22)
    return float(np.rad2deg(scale * np.pi / np.sqrt(3)))


def peer_scene(groom: Path, light_sampling: str) -> Scene:
    """The scene of a groom file as near to the peers' as a scene of furcl can be.

    128 x 128 pixels, 16 bounces, no roulette, constant light; fibres without a medulla and with the
    lobe of longer paths; the scalp is a diffuse sphere.
    """
    with np.load(groom) as file:
        facts = json.loads(str(file["scene"]))
    fibre, scalp = facts["fibre"], facts["scalp"]
    return decode_scene(
        {
            "name": groom.stem,
            "film": {"width": 128, "height": 128},
            "camera": facts["camera"],
            "fibre": {
                "eta": fibre["ior"],
                "alpha_deg": fibre["tilt_deg"],
                "beta_m_deg": longitudinal_deg(fibre["beta_m"]),
                "beta_n_deg": azimuthal_deg(fibre["beta_n"]),
                "sigma_ca": fibre["sigma_a"],
            },
            "environment": {"kind": "constant", "radiance": facts["environment"]},
            "curves": {"generator": "file", "file": str(groom.resolve())},
            "body": {
                "centre": scalp["center"],
                "radii": [scalp["radius"]] * 3,
                "albedo": scalp["albedo"],
            },
            "render": {
                "max_depth": 16,
                "roulette_depth": 16,
                "light_sampling": light_sampling,
                "residual": True,
            },
        },
        groom.stem,
    )


def run(folder: Path, device: str | None, spp: int, rounds: int) -> dict[str, Any]:
    """Measure every groom in both ways of finding light; rows of `furcl.bench.stages.measure`."""
    opened = open_device(device)
    rows = []
    for name in GROOMS:
        for light_sampling in LIGHT_SAMPLING:
            scene = peer_scene(folder / f"{name}.npz", light_sampling)
            row = measure(scene, opened, spp, rounds)
            rows.append({"light_sampling": light_sampling, **row})
            print(
                f"{name} {light_sampling}: {row['mpaths_s']:.3f} M paths/s, "
                f"{row['mrays_s']:.3f} M rays/s, {row['wall_seconds']:.1f} s for {spp} spp"
            )
    return {**circumstances(opened), "spp": spp, "rounds": rounds, "rows": rows}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="with hair10k.npz and fur100k.npz")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--device")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--rounds", type=int, default=1)
    given = parser.parse_args()
    results = run(given.folder, given.device, given.spp, given.rounds)
    write_json(results, given.output / "results.json")
