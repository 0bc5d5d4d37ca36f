"""Render docs/pictures/scattering.png: fur with scattered light as published and as simulated.

python docs/make_scattering.py [--size N] [--spp N] [--out FOLDER] [--device TEXT]

Each scene both ways, with the same exposure. Writes bench/results/scattering.json as well: mean
radiances where the fur is, with the standard error of each mean, and their ratio.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

import furcl
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.scene.read import load_scene, with_overrides

ROOT = Path(__file__).parents[1]
SCENES = ("raccoon", "red_fox")
WAYS = ("model", "simulated")
LINE = 14
# The layer A then says what part of a pixel is covered.
ALONE = "film.background=transparent"
GREY = (118, 118, 118, 255)  # behind the fur


def of_fur(image: furcl.Image) -> dict[str, Any]:
    """Mean radiance of the covered part of a picture, a channel each, and its standard error."""
    assert image.variance is not None
    covered = image.layers["A"].mean(dtype=np.float64)
    pixels = image.width * image.height
    error = np.sqrt(image.variance.sum(axis=(0, 1), dtype=np.float64)) / pixels
    return {
        "radiance": (image.rgb.mean(axis=(0, 1), dtype=np.float64) / covered).tolist(),
        "error": (error / covered).tolist(),
    }


def sheet(images: dict[tuple[str, str], furcl.Image]) -> Image.Image:
    """A line for every scene, the ways beside each other with their names below."""
    first = next(iter(images.values()))
    width, height = first.width, first.height + LINE
    out = Image.new("RGB", (len(WAYS) * width, len(SCENES) * height), "white")
    draw = ImageDraw.Draw(out)
    for (name, way), image in images.items():
        x, y = WAYS.index(way) * width, SCENES.index(name) * height
        tile = Image.open(io.BytesIO(image.png_bytes())).convert("RGBA")
        grey = Image.new("RGBA", tile.size, GREY)
        out.paste(Image.alpha_composite(grey, tile).convert("RGB"), (x, y))
        draw.text((x + 4, y + first.height + 1), f'{name}, scattering = "{way}"', fill="black")
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--size", type=int, default=256, metavar="N")
    parser.add_argument("--spp", type=int, default=256, metavar="N")
    parser.add_argument("--out", type=Path, default=ROOT, help="folder with docs/ and bench/")
    parser.add_argument("--device", default="", help="as for furcl render")
    given = parser.parse_args()
    device = open_device(given.device or None)
    images, found = {}, {}
    for name in SCENES:
        scene = load_scene(
            name, overrides=[ALONE], size=f"{given.size}x{given.size}", spp=given.spp
        )
        for way in WAYS:
            image = furcl.render(with_overrides(scene, [f"fibre.scattering={way}"]), device=device)
            images[name, way] = image
            found.setdefault(name, {})[way] = of_fur(image)
        both = [np.array(found[name][way]["radiance"]) for way in WAYS]
        found[name]["simulated_over_model"] = (both[1] / both[0]).tolist()
        print(name, found[name], flush=True)
    record = {**circumstances(device), "size": given.size, "spp": given.spp, "scenes": found}
    write_json(record, given.out / "bench" / "results" / "scattering.json")
    picture = given.out / "docs" / "pictures" / "scattering.png"
    picture.parent.mkdir(parents=True, exist_ok=True)
    sheet(images).save(picture, optimize=True)
    print(picture)


if __name__ == "__main__":
    main()
