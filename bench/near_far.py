"""The near picture averaged, beside the far one: the grooms of the paper's scenes at 8 times the
resolution, for docs/model.md.

    python bench/near_far.py [SCENE...] [--set KEY=VALUE] [-o FOLDER] [--size 32] [--spp 32]
        [--device TEXT]

Blocks of 8 x 8 pixels of mode near (h of the hit, at every bounce) and multiscale (of the camera's
hit alone, within a pixel) are compared with the pixels of mode far that they cover.
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
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene

Array = NDArray[np.float64]

SCENES = ("black_hair", "white_hair", "raccoon")
FOLDER_OF_SCENES = Path(__file__).parents[1] / "scenes"
FINER = 8
SETTINGS = (
    "film.filter=box", "film.background=transparent", "render.sequence=independent",
    "render.roulette=depth", "render.light_sampling=mis",
)  # fmt: skip
TWO_SIDED_95 = 1.96


def blocks(
    scene: str, mode: str, size: int, finer: int, spp: int, own: list[str], device: Device
) -> tuple[Array, Array]:
    """Channel means of finer x finer pixels (size, size), and their variances."""
    changes = [f"fibre.mode={mode}", f"render.spp={spp}", f"render.seed={finer}", *SETTINGS, *own]
    side = size * finer
    path = FOLDER_OF_SCENES / f"{scene}.toml"
    renderer = Renderer(load_scene(path, overrides=changes, size=(side, side)), device)
    renderer.advance(spp)
    image = renderer.image()
    assert image.variance is not None
    rgb, variance = (
        x.astype(np.float64).reshape(size, finer, size, finer, 3).mean((1, 3))
        for x in (image.rgb, image.variance)
    )
    # Channels are not independent: the error of their mean is at most the mean of their errors.
    error = np.sqrt(variance).mean(2) / finer
    return rgb.mean(2), error**2


def compared(
    scene: str, size: int, spp: int, own: list[str], device: Device
) -> list[dict[str, Any]]:
    """Rows of both modes: difference of the means over the far one, half its 95 % interval, the
    largest difference of a block in standard errors."""
    far, far_variance = blocks(scene, "far", size, 1, spp * FINER**2, own, device)
    rows = []
    for mode in ("near", "multiscale"):
        near, variance = blocks(scene, mode, size, FINER, spp, own, device)
        both = far_variance + variance
        seen = both > 0.0
        z = np.abs(near - far)[seen] / np.sqrt(both[seen])
        row = {
            "scene": scene, "changes": own, "mode": mode, "blocks": int(seen.sum()),
            "difference": float(near.sum() / far.sum() - 1.0),
            "half_interval": float(TWO_SIDED_95 * np.sqrt(both.sum()) / far.sum()),
            "largest_z": float(z.max()),
        }  # fmt: skip
        print(row)
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", nargs="*", help=", ".join(SCENES))
    parser.add_argument("--set", dest="own", action="append", default=[])
    parser.add_argument("-o", "--output", type=Path, default=FOLDER / "near_far" / "scenes")
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--device")
    asked = parser.parse_args()
    device = open_device(asked.device)
    rows = []
    for scene in asked.scenes or SCENES:
        rows += compared(scene, asked.size, asked.spp, asked.own, device)
    results = {"schema": "furcl-near-far-1", **circumstances(device), "size": asked.size}
    write_json({**results, "spp": asked.spp, "rows": rows}, asked.output / "results.json")


if __name__ == "__main__":
    main()
