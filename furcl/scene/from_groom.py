"""A scene of nothing but a groom file: framed, under a sky, of a fibre by name."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from furcl.errors import SceneError
from furcl.files import atomic_path, check_writable
from furcl.groom.formats import suffixes
from furcl.values import shown

MATERIAL = "brown"
#: Radius of the strands of files without radii, of the size of the groom.
RADIUS_SHARE = 2.5e-4
#: Albedo of meshes beside a groom.
SKIN = (0.5, 0.38, 0.3)

TEMPLATE = """\
# {title}
#     furcl render {name} -o {stem}.exr
# Every key: docs/scene.md. Lengths are in the unit of the groom's file; z is up.

[camera]                     # without an origin it frames the groom
azimuth_deg = -60            # of the camera, from +x towards +y
elevation_deg = 10
vfov_deg = 25

[film]
width = 512
height = 512
exposure_stops = 0           # of the .png; the .exr is linear

[fibre]
{material}
# sigma_ca = [0.4, 0.8, 1.6] # absorption per fibre radius, instead of the preset's
# beta_m_deg = 6             # width of highlights along the fibre

[environment]
kind = "sky"                 # or "constant", or "image" with file = "LIGHT.exr"
sun_elevation_deg = 45
sun_azimuth_deg = -20
sun_radius_deg = 3           # larger: softer shadows
turbidity = 3
scale = 0.04

[curves]
generator = "file"
file = {file}
radius_scale = 1.0           # thin strands that leave the groom transparent: widen them
default_radius_share = {share}  # of the groom's size, where the file has no radii
{up}
{mesh}[render]
spp = 64                     # noise falls with its square root
"""
MESH = """\
[mesh.body]
file = {file}
albedo = {albedo}
{transform}
"""


def is_groom(path: Path) -> bool:
    """Whether a file's name is that of a groom."""
    return path.name.lower().endswith(suffixes())


def groom_document(path: Path) -> dict[str, Any]:
    """The scene document of a groom file: seen from the side, under a sky with a soft sun, the
    meshes of its stage beside the strands."""
    from furcl.groom.formats.usd_mesh import has_meshes

    meshes = {"mesh": {"body": {"file": str(path), "albedo": list(SKIN)}}}
    return {
        "camera": {"azimuth_deg": -60.0, "elevation_deg": 10.0, "vfov_deg": 25.0},
        "film": {"width": 512, "height": 512},
        "fibre": {"preset": MATERIAL},
        "environment": {
            "kind": "sky",
            "sun_elevation_deg": 45.0,
            "sun_azimuth_deg": -20.0,
            "sun_radius_deg": 3.0,
            "turbidity": 3.0,
            "scale": 0.04,
        },
        "curves": {
            "generator": "file",
            "file": str(path),
            "default_radius_share": RADIUS_SHARE,
        },
        "render": {"spp": 64},
        **(meshes if has_meshes(path) else {}),
    }


def material_override(name: str) -> str:
    """The change of a scene that gives it a fibre by name: a preset, or a model's defaults.

    Raises
    ------
    SceneError      neither a preset nor a model, with those that there are
    """
    from furcl.fibre.double_cylinder.parameters import Fibre
    from furcl.fibre.model import names

    if name in Fibre.preset_names():
        return f"fibre.preset={name}"
    if name in names():
        return f"fibre.model={name}"
    raise SceneError(
        f"material {shown(name)} is not known; presets are {', '.join(Fibre.preset_names())}; "
        f"models are {', '.join(names())}"
    )


def write_scene(
    path: Path, groom: Path, mesh: Path | None, material: str = MATERIAL, up_axis: str | None = None
) -> None:
    """Write a commented scene of a groom, and a mesh beside it, that renders as it is.

    Raises
    ------
    SceneError      there is such a file already, or one that it names is not there
    """
    from furcl.groom.formats.usd_mesh import turns_itself
    from furcl.scene.read import load_scene

    if path.suffix.lower() != ".toml":
        raise SceneError(f"{path}: a scene's name must end with .toml; give another name")
    if path.exists():
        raise SceneError(f"{path}: is there already; give another name, or remove it")
    check_writable(path, SceneError)
    key, value = material_override(material).removeprefix("fibre.").split("=")
    turned = up_axis or _said_up(groom)
    text = TEMPLATE.format(
        title=f"{groom.name}, framed, under a sky.",
        name=path.name,
        stem=path.stem,
        material=f"{key} = {_quoted(value):<20} # or another: docs/scene.md",
        file=_quoted(_beside(groom, path)),
        share=RADIUS_SHARE,
        up=f"up_axis = {_quoted(up_axis)}\n" if up_axis else '# up_axis = "y"\n',
        mesh=_mesh(mesh, path, None if turns_itself(mesh) else turned) if mesh else "",
    )
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
        load_scene(temporary)


def _said_up(groom: Path) -> str | None:
    from furcl.groom.formats import load_curves

    return load_curves(groom, default_radius=1.0).units.up_axis


def _mesh(mesh: Path, path: Path, up_axis: str | None) -> str:
    turn = "transform.rotate_deg = [90.0, 0.0, 0.0]  # y is up in its file, as in the groom's\n"
    return MESH.format(
        file=_quoted(_beside(mesh, path)),
        albedo=list(SKIN),
        transform=turn if up_axis == "y" else "# transform.rotate_deg = [90.0, 0.0, 0.0]\n",
    )


def _beside(file: Path, scene: Path) -> str:
    """The name of a file as the scene names it: relative to its folder, where it is below."""
    target, folder = file.absolute(), scene.absolute().parent
    relative = os.path.relpath(target, folder)
    return str(target) if relative.startswith("../..") else relative


def _quoted(text: str) -> str:
    """A text in TOML."""
    escaped = "".join(
        f"\\u{ord(c):04x}" if ord(c) < 32 or c in '"\\' or ord(c) == 127 else c for c in text
    )
    return f'"{escaped}"'
