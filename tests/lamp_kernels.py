"""Lamps that several tests share, and the functions of light/lights.clh on arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from environments import make_environment
from light_kernels import launch
from numpy.typing import NDArray

from furcl.device import layout
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.device.source import expand
from furcl.light.lamps.lamps import Lamps
from furcl.light.lamps.planar import flat
from furcl.light.lights import Lights
from furcl.scene import lamps as tables
from furcl.scene.lamps import DiskLamp, DistantLamp, Lamp, PointLamp, QuadLamp, SphereLamp, SpotLamp
from furcl.scene.transform import Transform

# Where the environment's strength is taken, and points around it, one of them in a lamp's bounds.
MIDDLE = np.array([0.1, 0.2, 0.3])
POINTS = np.array(
    [[0.0, 0.0, 0.0], [0.4, -0.3, 0.6], [-1.5, 1.0, 0.2], [30.0, -20.0, 10.0], [1.0, -1.0, 1.4]]
)

ONES: dict[str, Lamp] = {
    "quad": QuadLamp(
        position=(1.0, -1.0, 1.5), target=(0.0, 0.0, 0.0), size=(0.8, 0.5), radiance=3.0,
        colour=(1.0, 0.5, 0.2),
    ),
    "sheared quad": QuadLamp(
        transform=Transform(
            matrix=(
                (0.5, 0.3, 0.0, -0.7), (0.1, 0.6, 0.0, 0.2), (0.0, 0.2, 1.0, 1.6),
                (0.0, 0.0, 0.0, 1.0),
            )
        ),
        power=4.0,
        two_sided=True,
    ),
    "disk": DiskLamp(
        transform=Transform(scale=(1.0, 0.5, 1.0), rotate_deg=(20.0, 30.0, 0.0),
                            translate=(-0.4, 0.3, 2.0)),
        radius=0.4, radiance=2.0,
    ),
    "sphere": SphereLamp(position=(0.5, 1.5, 0.8), radius=0.3, power=6.0),
    "point": PointLamp(position=(-0.6, -0.8, 1.1), intensity=0.7, colour=(0.2, 0.4, 1.0)),
    "spot": SpotLamp(
        position=(1.5, 1.0, 2.0), target=(0.0, 0.2, 0.0), cone_deg=25.0, edge_deg=10.0, power=2.0
    ),
    "sun": DistantLamp(target=(-1.0, 0.5, -1.0), angle_deg=8.0, irradiance=0.6),
    "direction": DistantLamp(target=(0.3, 0.5, -1.0), angle_deg=0.0, irradiance=0.4),
}  # fmt: skip


def build(lamps: dict[str, Lamp], environment: str | None = None, **changes) -> Lights:
    """The light of tables, with one of environments.ENVIRONMENTS."""
    around = make_environment(environment) if environment else None
    return Lights(around, tables.build(lamps, **changes))


def lamps_of(lights: Lights) -> Lamps:
    """Those of a light that has some."""
    assert lights.lamps is not None
    return lights.lamps


def triangles(n: int, seed: int = 3) -> Lamps:
    """Lamps of small triangles that look everywhere."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-2.0, 2.0, (n, 3)) + np.array([0.0, 0.0, 3.0])
    edges = rng.normal(0.0, 0.15, (2, n, 3))
    return Lamps.make(
        [flat("triangle", corners, edges[0], edges[1], rng.uniform(0.0, 5.0, (n, 3)))]
    )


def spread_quads(n: int, seed: int = 5, **changes) -> dict[str, Lamp]:
    """Small quads all around, of all strengths."""
    rng = np.random.default_rng(seed)
    return {
        f"quad{i}": QuadLamp(
            position=tuple(rng.uniform(-3.0, 3.0, 3)), target=tuple(rng.uniform(-1.0, 1.0, 3)),
            size=(0.2, 0.1), radiance=float(rng.exponential(3.0)), **changes,
        )
        for i in range(n)
    }  # fmt: skip


def scenes() -> dict[str, Lights]:
    """Every lamp alone, many of a kind, and all kinds in a sky."""
    return {
        **{name: build({name: lamp}) for name, lamp in ONES.items()},
        "triangles": Lights(None, triangles(37)),
        "quads": build(spread_quads(64)),
        "by power": build(spread_quads(64), by_position=False),
        "quads in even light": build(spread_quads(5), "constant"),
        "two at infinity": build({name: ONES[name] for name in ("sun", "direction")}, "sky"),
        "all": build(ONES, "sky"),
    }


KERNELS = """
__kernel void choose(
    __global const float* light, __global const float* points, __global const float* u,
    __global const float* choice, __global float* directions, __global float* distances,
    __global float* radiance, __global float* pdf, __global float* lamp, __global float* found)
{
    const uint i = get_global_id(0);
    const ChosenLight chosen = choose_light(
        light, vload3(i, points), vload2(i, u), vload4(i, choice));
    vstore3(chosen.sample.direction, i, directions);
    distances[i] = chosen.sample.distance;
    vstore3(chosen.sample.radiance, i, radiance);
    pdf[i] = chosen.sample.pdf;
    found[i] = chosen.rays_find_it;
#if FURCL_AREA_LAMPS
    lamp[i] = chosen.lamp == FURCL_NO_LAMP ? -1.0f : (float)chosen.lamp;
#else
    lamp[i] = -1.0f;
#endif
}

__kernel void trace(
    __global const float* light, __global const float* points, __global const float* directions,
    __global const float* ignored, __global float* distances, __global float* lamp)
{
    const uint i = get_global_id(0);
    const Query query = {vload3(i, points), vload3(i, directions), FURCL_NO_SEGMENT};
    Hit hit = {INFINITY, -1.0f, FURCL_NO_SEGMENT};
#if FURCL_AREA_LAMPS
    lamps_hit(light, &query, ignored[i] < 0.0f ? FURCL_NO_LAMP : (uint)ignored[i], &hit);
#endif
    distances[i] = hit.t;
    lamp[i] = hit.u;
}

__kernel void weigh(
    __global const float* light, __global const float* points, __global const float* directions,
    __global const float* pdf, __global const float* lamp, __global const float* distances,
    __global float* radiance)
{
    const uint i = get_global_id(0);
    const float3 origin = vload3(i, points), direction = vload3(i, directions);
    float3 found;
#if FURCL_AREA_LAMPS || FURCL_LAMP_TRIANGLE
    if (lamp[i] >= 0.0f)
        found = radiance_of_lamp(light, (uint)lamp[i], distances[i], origin, direction, pdf[i]);
    else
#endif
        found = radiance_from_infinity(light, origin, direction, pdf[i]);
    vstore3(found, i, radiance);
}
"""


class Chosen(NamedTuple):
    """As furcl.light.lights.ChosenLights, in float32; `lamp` is known where rays meet lamps."""

    directions: NDArray[np.float32]
    distances: NDArray[np.float32]
    radiance: NDArray[np.float32]
    pdf: NDArray[np.float32]
    lamp: NDArray[np.float32]
    found: NDArray[np.float32]


def _run(device: Device, lights: Lights, kernel: str, inputs, widths):
    """Outputs (n, width) or (n,) of a kernel of this file over rows of values."""
    features = Features(light=lights.environment_part, lamps=lights.lamps_part, light_sampling=True)
    text = expand("light/lights.clh", features) + KERNELS
    lanes = {"FURCL_LANES": 1, "FURCL_PATHS_PER_ITEM": 1}
    text = layout.declarations(text, features, lanes) + text
    n = len(inputs[-1])
    arrays = [lights.device_buffer(True, MIDDLE)]
    for values in inputs:
        values = np.asarray(values, np.float32)
        rows = np.broadcast_to(values, (n, *values.shape[-1:])) if values.ndim > 1 else values
        arrays.append(np.ascontiguousarray(rows))
    return launch(device, program_text(text), kernel, arrays, n, widths)


def program_text(text: str) -> str:
    """What is compiled: tests put mistakes into it."""
    return text


def choose(device: Device, lights: Lights, points, u, choice) -> Chosen:
    """Light samples at points (n, 3) by numbers u (n, 2) and choice (n, 4)."""
    return Chosen(*_run(device, lights, "choose", (points, u, choice), (3, 1, 3, 1, 1, 1)))


def trace(device: Device, lights: Lights, points, directions, ignored=None):
    """Distance and number of the lamp that each ray meets; inf and -1: none."""
    ignored = np.full(len(points), -1.0) if ignored is None else ignored
    distances, lamp = _run(device, lights, "trace", (points, directions, ignored), (1, 1))
    return distances, lamp.astype(int)


def weigh(device: Device, lights: Lights, points, directions, pdf, lamp, distances):
    """Radiance (n, 3) that rays bring, weighed against light samples of their origins."""
    return _run(device, lights, "weigh", (points, directions, pdf, lamp, distances), (3,))[0]
