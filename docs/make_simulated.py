"""Pictures of both ways of scattering, side by side: python docs/make_simulated.py [--spp N].

Writes docs/pictures/simulated.png: raccoon and red fox, left as the model is published, right with
fibre.scattering = "simulated".
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from make_pictures import OUT, picture
from PIL import Image

import furcl
from furcl.scene.read import with_overrides

SCENES = ("raccoon", "red_fox")
SIZE, SPP = 160, 48


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--spp", type=int, default=SPP)
    parser.add_argument("--size", type=int, default=SIZE)
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    sheet = Image.new("RGB", (2 * given.size, len(SCENES) * given.size))
    for row, name in enumerate(SCENES):
        for column, scattering in enumerate(("model", "simulated")):
            scene = with_overrides(furcl.load_scene(name), [f"fibre.scattering={scattering}"])
            made = picture(scene, given.size, given.spp)
            sheet.paste(made, (column * given.size, row * given.size))
            print(name, scattering, np.asarray(made).mean((0, 1)).round(1), flush=True)
    sheet.save(given.out / "simulated.png", optimize=True)


if __name__ == "__main__":
    main()
