"""Render the pictures of the README: python docs/make_pictures.py [NAME ...] [--data FOLDER].

Writes the PNG files of docs/pictures, 256 samples a pixel. Those of GROOMS want a folder with
`hair/` and `mesh/` that holds the files named there; without --data they are left as they are.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

from PIL import Image, ImageDraw

import furcl
from furcl.scene.read import with_overrides
from furcl.scene.tables import Scene

OUT = Path(__file__).with_name("pictures")
SIZE, SPP = 160, 256
TILE, LINE, COLUMNS = 128, 14, 4

SKIN = ["albedo=[0.58,0.38,0.29]", "coat.eta=1.4", "coat.roughness=0.45"]
FACE = ["camera={origin=[-0.5,-1.2,1.6],target=[0,0,1.52],vfov_deg=16}"]
# Name -> groom, mesh, settings of the mesh, settings of the scene beside groom and mesh.
GROOMS = {
    "sintel_straight": (
        "sintel_straight.hair", "sintel_head.obj", SKIN,
        ["fibre.preset=red", *FACE],
    ),
    "sintel_curly": (
        "sintel_curly.hair", "sintel_head.obj", SKIN,
        ["curves.radius_scale=6", "fibre.preset=brown", *FACE],
    ),
    "bear_fur": (
        "bear_fur.hair", "bear_body.ply", ["albedo=[0.06,0.04,0.03]"],
        ["curves.radius_scale=2.5", "fibre.preset=brown", "camera.azimuth_deg=50",
         "film.exposure_stops=0.7"],
    ),
    "bunny_fur": (
        "bunny_fur.hair", "bunny.ply", ["albedo=[0.45,0.33,0.28]", "transform.scale=10"],
        ["curves.radius_scale=4", "fibre.preset=blond"],
    ),
}  # fmt: skip
# Y is up in all of them.
UP = ["curves.up_axis=y", "mesh.body.transform.rotate_deg=[90,0,0]"]
SCENES = ("black_hair", "red_fox", "portrait", "lamps")
SHEET = "presets"


def of_groom(name: str, data: Path) -> Scene:
    """A groom on its body."""
    groom, mesh, of_mesh, settings = GROOMS[name]
    files = [f"curves.file={data / 'hair' / groom}", f"mesh.body.file={data / 'mesh' / mesh}"]
    body = [f"mesh.body.{setting}" for setting in of_mesh]
    return furcl.load_scene("groom", overrides=[*files, *UP, *body, *settings])


def of_preset(name: str) -> Scene:
    """A ball of fur of a preset."""
    fur = ["curves.n_strands=30000", "curves.radius=0.004"]
    return furcl.load_scene("red_fox", overrides=[f'fibre={{preset="{name}"}}', *fur])


def picture(scene: Scene, size: int, spp: int) -> Image.Image:
    """A square picture of a scene."""
    settings = [f"film.width={size}", f"film.height={size}"]
    image = furcl.render(with_overrides(scene, settings, spp=spp))
    return Image.open(io.BytesIO(image.png_bytes())).convert("RGB")


def sheet(spp: int) -> Image.Image:
    """All presets of the double cylinder, with their names."""
    names = furcl.Fibre.preset_names()
    height = TILE + LINE
    out = Image.new("RGB", (COLUMNS * TILE, -(-len(names) // COLUMNS) * height), "white")
    draw = ImageDraw.Draw(out)
    for i, name in enumerate(names):
        x, y = i % COLUMNS * TILE, i // COLUMNS * height
        out.paste(picture(of_preset(name), TILE, spp), (x, y))
        draw.text((x + 4, y + TILE + 1), name, fill="black")
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="pictures; all that can be made if left out")
    parser.add_argument("--data", type=Path, help="folder of the grooms and their bodies")
    parser.add_argument("--spp", type=int, default=SPP)
    parser.add_argument("--size", type=int, default=SIZE)
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    possible = [*(GROOMS if given.data else ()), *SCENES, SHEET]
    unknown = [name for name in given.names if name not in possible]
    if unknown:
        parser.error(f"{unknown[0]}: allowed are {', '.join(possible)} (grooms need --data)")
    for name in given.names or possible:
        if name == SHEET:
            made = sheet(given.spp)
        else:
            groom = name in GROOMS
            scene = of_groom(name, given.data) if groom else furcl.load_scene(name)
            made = picture(scene, given.size, given.spp)
        made.save(given.out / f"{name}.png", optimize=True)
        print(given.out / f"{name}.png", flush=True)


if __name__ == "__main__":
    main()
