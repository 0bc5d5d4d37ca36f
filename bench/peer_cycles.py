"""Cycles as one of the renderers of bench/peers.py; needs bpy alone.

Curves are ribbons. Every render of Cycles gives its kernels the scene anew, which is no part of
rendering here: the time of a render with one sample is taken off. Its numbers are Sobol's.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from peer_worker import Render, Task, serve


def prepare(task: Task, folder: Path) -> tuple[Render, dict[str, Any]]:
    """The scene, in Blender's terms."""
    import bpy
    from mathutils import Vector

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    _settings(scene, task)
    world = bpy.data.worlds.new("even")
    scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*task["environment"], 1.0)
    world.cycles.sampling_method = "AUTOMATIC"

    def looking(thing: Any, origin: list[float], target: list[float]) -> None:
        thing.location = origin
        direction = Vector(target) - Vector(origin)
        thing.rotation_mode = "QUATERNION"
        thing.rotation_quaternion = direction.to_track_quat("-Z", "Y")

    def added(name: str, data: Any) -> Any:
        thing = bpy.data.objects.new(name, data)
        scene.collection.objects.link(thing)
        return thing

    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "VERTICAL"
    camera.angle = math.radians(task["camera"]["vfov_deg"])
    scene.camera = added("camera", camera)
    looking(scene.camera, task["camera"]["origin"], task["camera"]["target"])

    lamp = task["lamp"]
    quad = bpy.data.lights.new("lamp", "AREA")
    quad.shape, quad.size = "SQUARE", lamp["size"]
    # Blender gives an area light's power over pi, so that its radiance is energy / (4 area).
    # Its lamps hide nothing: what lies behind comes through.
    radiance = lamp["radiance"] - task["environment"][0]
    quad.energy = radiance * math.pi * lamp["size"] ** 2
    looking(added("lamp", quad), lamp["position"], lamp["target"])

    _scalp(bpy, added, folder / "scalp.ply", task["scalp_albedo"])
    _hair(bpy, added, np.load(folder / "groom.npz"), task["fibre"])
    picture = folder / "cycles.exr"
    scene.render.filepath = str(picture)

    def rendered(seed: int, spp: int) -> Any:
        scene.cycles.seed, scene.cycles.samples = seed, spp
        start = time.perf_counter()
        bpy.ops.render.render(write_still=True)
        seconds = time.perf_counter() - start
        loaded = bpy.data.images.load(str(picture))
        loaded.colorspace_settings.name = "Non-Color"
        values = np.empty(len(loaded.pixels), np.float32)
        loaded.pixels.foreach_get(values)
        width, height = loaded.size
        bpy.data.images.remove(loaded)
        return seconds, values.reshape(height, width, 4)[::-1]

    rendered(0, 1)
    set_up = min(rendered(seed, 1)[0] for seed in range(3))

    def render(seed: int, spp: int) -> Any:
        seconds, values = rendered(seed, spp)
        return values, seconds - set_up

    return render, {"version": f"Cycles {bpy.app.version_string}, ribbons"}


def _settings(scene: Any, task: Task) -> None:
    """Film and integrator."""
    render, cycles = scene.render, scene.cycles
    render.resolution_x = render.resolution_y = task["size"]
    render.resolution_percentage = 100
    render.use_persistent_data = True
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    scene.view_settings.view_transform = "Raw"
    cycles.device = "CPU"
    cycles.pixel_filter_type = "BOX"
    cycles.filter_width = 1.0
    cycles.use_denoising = False
    cycles.use_adaptive_sampling = False
    scene.cycles_curves.shape = "RIBBONS"
    # Its clamp and its blur of caustics change the picture.
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.blur_glossy = 0.0
    # It counts what follows the first scattering.
    depth = task["bounces"] - 1
    cycles.max_bounces = depth
    cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = depth
    cycles.min_light_bounces = depth if task["same_settings"] else 0
    if task["same_settings"]:
        cycles.light_sampling_threshold = 0.0


def _scalp(bpy: Any, added: Any, path: Path, albedo: list[float]) -> None:
    """The mesh of an ASCII .ply of triangles."""
    lines = path.read_text("ascii").split("end_header\n")[1].splitlines()
    rows = [line.split() for line in lines]
    corners = [tuple(map(float, row)) for row in rows if len(row) == 3]
    faces = [tuple(map(int, row[1:])) for row in rows if len(row) == 4]
    mesh = bpy.data.meshes.new("scalp")
    mesh.from_pydata(corners, [], faces)
    material = bpy.data.materials.new("scalp")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    diffuse, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    diffuse.inputs["Color"].default_value = (*albedo, 1.0)
    links.new(diffuse.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    added("scalp", mesh)


def _hair(bpy: Any, added: Any, groom: Any, fibre: dict[str, Any]) -> None:
    """The groom, of polylines, and Chiang's fibre."""
    curves = bpy.data.hair_curves.new("hair")
    curves.add_curves(np.diff(groom["offsets"].astype(np.int64)).tolist())
    curves.set_types(type="POLY")
    points = np.ascontiguousarray(groom["points"], np.float32).ravel()
    curves.attributes["position"].data.foreach_set("vector", points)
    radius = curves.attributes.get("radius") or curves.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.ascontiguousarray(groom["radii"], np.float32))
    material = bpy.data.materials.new("hair")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    hair, output = nodes.new("ShaderNodeBsdfHairPrincipled"), nodes.new("ShaderNodeOutputMaterial")
    hair.model, hair.parametrization = "CHIANG", "ABSORPTION"
    for name, value in {
        "Absorption Coefficient": fibre["sigma_a"],
        "Roughness": fibre["beta_m"],
        "Radial Roughness": fibre["beta_n"],
        "Coat": 0.0,
        "IOR": fibre["eta"],
        "Offset": math.radians(fibre["alpha_deg"]),
        "Random Roughness": 0.0,
    }.items():
        hair.inputs[name].default_value = value
    links.new(hair.outputs[0], output.inputs["Surface"])
    curves.materials.append(material)
    added("hair", curves)


if __name__ == "__main__":
    serve(prepare)
