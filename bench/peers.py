"""Render the grooms that other renderers were measured on, and write paths and rays a second.

python bench/peers.py -o bench/results/peers/portable [--device D] [--spp 256]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from peer_grooms import GROOMS, facts, grow

from furcl.bench.record import circumstances, write_json
from furcl.bench.stages import measure
from furcl.device.choice import open_device
from furcl.groom.formats import save_curves
from furcl.scene.read import decode_scene
from furcl.scene.tables import Scene

ROUGHNESS = 0.3  # beta_m and beta_n of the peers' fibres

# Light found by fibres alone, and by a light sample at every vertex as well: the peers' way.
LIGHT_SAMPLING = ("bcsdf", "mis")


def longitudinal_deg(beta_m: float) -> float:
    """Standard deviation of R [deg] of the roughness beta_m (Chiang et al. 2016, equation 7)."""
    return float(np.rad2deg(0.726 * beta_m + 0.812 * beta_m**2 + 3.7 * beta_m**20))


def azimuthal_deg(beta_n: float) -> float:
    """Standard deviation [deg] of the logistic of beta_n (Chiang et al. 2016, equation 8)."""
    scale = np.sqrt(np.pi / 8) * (0.265 * beta_n + 1.194 * beta_n**2 + 5.372 * beta_n**22)
    return float(np.rad2deg(scale * np.pi / np.sqrt(3)))


def peer_scene(name: str, groom: Path, light_sampling: str) -> Scene:
    """The scene around a groom file, as near to the peers' as a scene of furcl can be.

    128 x 128 pixels, 16 bounces, no roulette, constant light; fibres without a medulla and with the
    lobe of longer paths; the scalp is a diffuse sphere.
    """
    return decode_scene(
        {
            "name": name,
            "film": {"width": 128, "height": 128},
            **facts(name),
            "fibre": {
                "eta": 1.55,
                "alpha_deg": 2.0,
                "beta_m_deg": longitudinal_deg(ROUGHNESS),
                "beta_n_deg": azimuthal_deg(ROUGHNESS),
                "sigma_ca": [0.126, 0.209, 0.411],
            },
            "curves": {"generator": "file", "file": str(groom.resolve())},
            "render": {
                "max_depth": 16,
                "roulette": "depth",
                "roulette_depth": 16,
                "light_sampling": light_sampling,
                "residual": True,
            },
        },
        name,
    )


def run(
    folder: Path, device: str | None, spp: int, rounds: int, n_strands: int | None
) -> dict[str, Any]:
    """Measure every groom in both ways of finding light; rows of `furcl.bench.stages.measure`."""
    opened = open_device(device)
    rows = []
    for name in GROOMS:
        save_curves(grow(name, n_strands), folder / f"{name}.npz")
        for light_sampling in LIGHT_SAMPLING:
            scene = peer_scene(name, folder / f"{name}.npz", light_sampling)
            row = measure(scene, opened, spp, rounds)
            rows.append({"light_sampling": light_sampling, **row})
            print(
                f"{name} {light_sampling}: {row['mpaths_s']:.3f} M paths/s, "
                f"{row['mrays_s']:.3f} M rays/s, {row['wall_seconds']:.1f} s for {spp} spp"
            )
    return {**circumstances(opened), "spp": spp, "rounds": rounds, "rows": rows}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--device")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--strands", type=int, help="thin the grooms")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        results = run(Path(folder), given.device, given.spp, given.rounds, given.strands)
    write_json(results, given.output / "results.json")
