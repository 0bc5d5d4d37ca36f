"""What `furcl info` says of a groom, of a scene, and of what a scene needs of a device."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from furcl.cli import warnings
from furcl.fibre.absorption import unused_attributes
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.model import ModelTable
from furcl.groom.curves import Curves
from furcl.groom.joined import Grooms
from furcl.groom.widths import question
from furcl.scene.tables import Film, Scene
from furcl.surface.mesh.mesh import Meshes
from furcl.table import Table

if TYPE_CHECKING:  # facts of grooms need no OpenCL
    from furcl.device.choice import Device
    from furcl.device.memory import Memory
    from furcl.fibre.double_cylinder.profiles import MedullaProfiles
    from furcl.fibre.material import FibreMaterial


def of_groom(path: Path, curves: Curves) -> dict[str, str]:
    """Counts, lengths, radii, bounds and units of what was read from a groom file."""
    asked = question(curves)
    return {
        "groom": str(path),
        "unit": str(curves.units),
        **_of_curves(curves),
        **({"question": asked} if asked else {}),
    }


def of_scene(scene: Scene) -> dict[str, str]:
    """What a scene holds, and what will make its picture black or slow; needs no device.

    Raises
    ------
    GroomError, ImageError, MeshError       if a file that the scene names cannot be used
    """
    film, render = scene.film, scene.render
    grooms, meshes = scene.build_grooms(), scene.build_meshes()
    curves = grooms.curves
    return {
        "scene": scene.name,
        "film": f"{film.width} x {film.height}, {film.filter} filter{_crop(film)}{_layers(film)}",
        **_of_cameras(scene),
        **_of_fibres(scene.build_fibres()),
        "environment": _environment(scene),
        **{f"lamp {name}": _values(lamp) for name, lamp in scene.lamp.items()},
        "render": f"{render.spp} spp, {render.sampling}, at most {render.max_depth} bounces",
        **_of_grooms(grooms, scene.materials()),
        **_of_curves(curves),
        **_of_meshes(scene, meshes),
        **{
            f"warning {n}": said
            for n, said in enumerate(warnings.of_scene(scene, curves, meshes), 1)
        },
    }


def _crop(film: Film) -> str:
    left, top, right, bottom = film.window.box
    return "" if film.window.whole else f", cropped to {left}, {top} to {right}, {bottom}"


def _layers(film: Film) -> str:
    background = "" if film.background == "light" else f", {film.background} background"
    layers = f", layers {', '.join(film.layers)}" if film.layers else ""
    return f"{background}{layers}"


def _of_cameras(scene: Scene) -> dict[str, str]:
    """A line for each of several cameras."""
    chosen = scene.chosen_camera
    return {
        f"camera {name}": f"{_values(camera)}{' (of this picture)' if camera is chosen else ''}"
        for name, camera in scene.cameras.items()
    }


def _values(table: Table) -> str:
    """What a table is and what is said in it."""
    tag = table.__struct_config__.tag
    said = {
        field.encode_name: getattr(table, field.name)
        for field in msgspec.structs.fields(table)
        if getattr(table, field.name) != field.default
    }
    values = (f"{key} {value}" for key, value in said.items())
    return ", ".join([*([str(tag)] if tag else []), *values])


def on_device(scene: Scene, device: str | Device | None = None) -> dict[str, str]:
    """Lobe shares, medulla tables, features and memory of a scene on a device.

    Sets a render up to its first sample, so that nothing here is an estimate.

    Raises
    ------
    DeviceError, GroomError, SceneError, ResourceError, KernelBuildError
    """
    from furcl.rendering.renderer import Renderer
    from furcl.rendering.specialise import compiled_in, left_out

    renderer = Renderer(scene, device)
    opened = renderer.device
    of_materials = {}
    for material in renderer.materials:
        facts = {
            **_of_double_cylinder(material, opened),
            "compiled in": ", ".join(compiled_in(material)),
            **{f"no {name}": why for name, why in left_out(material).items()},
        }
        of_materials |= _named(facts, material.name, len(renderer.materials))
    return {
        "device": f"{opened.name}, {opened.platform}, driver {opened.driver_version}",
        **of_materials,
        **_memory(renderer.memory),
        "set-up": ", ".join(f"{name} {t:.2f} s" for name, t in renderer.seconds.items()),
    }


def _named(facts: dict[str, str], name: str, count: int) -> dict[str, str]:
    """Facts of one of so many things, which are told apart by their names if they are several."""
    return {f"{name}: {key}": value for key, value in facts.items()} if count > 1 else facts


def _of_fibres(fibres: dict[str, Any]) -> dict[str, str]:
    facts = {}
    for name, fibre in fibres.items():
        of_fibre = {
            "fibre": f"{fibre.model}: {_parameters(fibre)}",
            "fibre's source": getattr(fibre, "provenance", "given by the user"),
        }
        facts |= _named(of_fibre, name, len(fibres))
    return facts


def _of_grooms(grooms: Grooms, materials: dict[str, ModelTable]) -> dict[str, str]:
    """A line for each of several grooms, and the arrays of files that nothing uses."""
    facts, names = {}, list(materials)
    for groom in grooms.grooms:
        material = names[groom.material]
        if len(grooms.grooms) > 1:
            of = f"{groom.curves.n_strands} strands, {groom.curves.n_segments} segments"
            facts[f"groom {groom.name}"] = f"{of} of {material}"
        unused = unused_attributes(groom.curves, materials[material].absorption)
        if unused:
            facts |= _named({"unused arrays": ", ".join(unused)}, groom.name, len(grooms.grooms))
    return facts


def _parameters(fibre: Any) -> str:
    """Every parameter; three equal channels as one number."""
    if not dataclasses.is_dataclass(fibre):
        return str(fibre)
    parts = []
    for field in dataclasses.fields(fibre):
        if not field.compare:
            continue
        channels = np.atleast_1d(getattr(fibre, field.name)).tolist()
        shown = channels if len(set(channels)) > 1 else channels[:1]
        unit = " deg" if field.name.endswith("_deg") else ""
        numbers = "/".join(x if isinstance(x, str) else f"{x:.4g}" for x in shown)
        parts.append(f"{field.name.removesuffix('_deg')} {numbers}{unit}")
    return ", ".join(parts)


def _environment(scene: Scene) -> str:
    clamped = scene.build_lights().n_negative
    found = f", {clamped} pixels below zero set to zero" if clamped else ""
    return f"{scene.environment or 'none'}{found}"


def _of_curves(curves: Curves) -> dict[str, str]:
    per_strand = np.diff(curves.offsets)
    lower, upper = curves.bounds()
    lengths = np.linalg.norm(np.diff(curves.points, axis=0), axis=1)[curves.segment_vertices()]
    left_out = curves.traced().dropped
    on_reading = _counts(curves.dropped)
    for_rays = _counts({k: n - curves.dropped.get(k, 0) for k, n in left_out.items()})
    return {
        "strands": f"{curves.n_strands}",
        "points": f"{curves.n_points} ({per_strand.min()} to {per_strand.max()} a strand)",
        "segments": f"{curves.n_segments}",
        "segment length": f"{np.median(lengths):.4g} (median), {lengths.max():.4g} (largest)",
        **({"arrays": _arrays(curves)} if curves.attributes or curves.ignored else {}),
        "radius": f"{curves.radii.min():.4g} to {curves.radii.max():.4g}",
        "bounds": f"{_point(lower)} to {_point(upper)}",
        **({"time steps": _times(curves.times)} if curves.times else {}),
        "memory": f"{curves.n_bytes / 2**20:.1f} MiB on the host",
        "left out on reading": on_reading,
        "left out for rays": for_rays,
    }


def _times(times: tuple[float, ...]) -> str:
    """How many, and from when to when."""
    return f"{len(times)}, {times[0]:g} to {times[-1]:g}"


def _of_meshes(scene: Scene, meshes: Meshes | None) -> dict[str, str]:
    if meshes is None:
        return {}
    facts = {}
    for name, mesh in zip(scene.mesh, meshes.meshes, strict=True):
        lower, upper = mesh.triangles.bounds()
        said = [
            f"{len(mesh.triangles)} triangles",
            "closed" if mesh.triangles.is_closed else "open",
            f"{_point(lower)} to {_point(upper)}",
        ]
        if mesh.texture is not None:
            said.append(f"a texture of {mesh.texture.shape[1]} x {mesh.texture.shape[0]}")
        said += [f"{count} {what}" for what, count in mesh.triangles.dropped.items()]
        facts[f"mesh {name}"] = ", ".join(said)
    return facts


def _arrays(curves: Curves) -> str:
    """The arrays of values of a groom's file."""
    known = [
        f"{name} (of {'strands' if len(values) == curves.n_strands else 'points'}"
        f"{', 3 numbers' if values.ndim > 1 else ''})"
        for name, values in curves.attributes.items()
    ]
    return ", ".join([*known, *(f"{name} (not read)" for name in curves.ignored)])


def _counts(left_out: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in left_out.items() if count) or "nothing"


def _point(p: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in p) + ")"


def _of_double_cylinder(material: FibreMaterial, device: Device) -> dict[str, str]:
    """Shares of the lobes over isotropic fibres, beside them the paper's for its three fibres, and
    the medulla's tables; nothing for other models."""
    from furcl.fibre.double_cylinder import reference
    from furcl.fibre.double_cylinder.paper import LOBE_SHARES

    fibre = material.fibre
    if not isinstance(fibre, Fibre):
        return {}
    # A render that leaves the scattered lobes out may still be of a fibre that has them.
    profiles = material.profiles or material.model.prepare(device, fibre)
    ours = reference.lobe_shares(fibre, profiles)
    lines = {"lobe shares": _percentages([100.0 * ours[lobe] for lobe in reference.LOBES])}
    for name, shares in LOBE_SHARES.items():
        if Fibre.preset(name) == fibre:
            lines["shares in the paper"] = _percentages(shares)
    return {**lines, "medulla tables": _medulla(profiles)}


def _percentages(shares: Sequence[float]) -> str:
    from furcl.fibre.double_cylinder.reference import LOBES

    return ", ".join(f"{lobe} {share:.3g} %" for lobe, share in zip(LOBES, shares, strict=True))


def _medulla(profiles: MedullaProfiles | None) -> str:
    if profiles is None:
        return "none: the medulla scatters nothing"
    return (
        f"{profiles.pack().nbytes / 1e3:.0f} kB, largest relative standard error "
        f"{profiles.relative_error:.2%}, {profiles.photons / 1e6:.1f} million photons"
    )


def _memory(memory: Memory) -> dict[str, str]:
    from furcl.bvh.build import BUFFERS

    groups = {
        "geometry": (*BUFFERS, "mesh shading"),
        "material": ("material",),
        "film": ("film", "film samples", "nonfinite", "layers"),
    }
    sizes = {name: sum(map(memory.held, parts)) for name, parts in groups.items()}
    sizes["environment"] = memory.held("light")
    sizes["path state"] = memory.total_bytes - sum(sizes.values())
    parts = ", ".join(f"{name} {size / 2**20:.2f}" for name, size in sizes.items())
    return {"device memory": f"{memory.total_bytes / 2**20:.2f} MiB: {parts}"}
