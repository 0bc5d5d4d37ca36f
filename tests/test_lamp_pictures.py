"""Pictures in the light of lamps: against a float64 renderer, closed forms, and each other."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from direction_statistics import sidak
from kernel_mutants import substitute
from scene_documents import INDEPENDENT, fur_patch, minimal
from scipy import stats
from test_light_pictures import N_BLOCKS, z_of_blocks

import furcl
from furcl.errors import SceneError
from furcl.fibre.double_cylinder.reference import UNSCATTERED
from furcl.oracle.host_render import HostRenderer
from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene, with_overrides
from furcl.scene.transform import Transform

ONES = {
    "quad": {
        "kind": "quad", "position": [0.5, 1.5, 0.9], "target": [0, 0, 0], "size": [2.0, 1.4],
        "radiance": 4.0, "colour": [1.0, 0.7, 0.4],
    },
    "disk": {
        "kind": "disk", "position": [-0.8, -1.1, 1.2], "target": [0, 0, 0], "radius": 0.8,
        "radiance": 6.0,
    },
    "sphere": {"kind": "sphere", "position": [0.6, 0.6, 1.0], "radius": 0.5, "power": 40.0},
    "point": {"kind": "point", "position": [-0.4, 0.7, 0.8], "intensity": 0.8},
    "spot": {
        "kind": "spot", "position": [0.4, 0.9, 1.1], "target": [0, 0, 0.1], "cone_deg": 25.0,
        "edge_deg": 12.0, "intensity": 2.0,
    },
    "sun": {
        "kind": "distant", "target": [-0.5, -1.0, -1.0], "angle_deg": 60.0, "irradiance": 1.0,
    },
    "direction": {
        "kind": "distant", "target": [0.5, -0.4, -1.0], "angle_deg": 0.0, "irradiance": 1.0,
    },
}  # fmt: skip
FOUND = ("quad", "disk", "sphere", "sun")  # by rays


def cross(lamps, environment=None, **render):
    """Three crossed fibres, 4 x 4 pixels, in the light of lamps."""
    document = {
        "film": {"width": 4, "height": 4, "filter": "box"},
        "camera": {"origin": [0, -3, 1.5], "target": [0, 0, 0], "vfov_deg": 12.0},
        "fibre": {"preset": "human-white", "kappa": 0.0, "beta_m_deg": 30.0, "beta_n_deg": 50.0},
        "curves": {
            "generator": "fibre", "count": 3, "axis": "x", "radius": 0.12, "length": 2.0,
            "spacing": 0.2,
        },
        "lamp": lamps,
        "render": {"spp": 4096, "max_depth": 3, **INDEPENDENT, **render},
    }  # fmt: skip
    return decode_scene(document | ({"environment": environment} if environment else {}), "cross")


def host_z(device, scene, factor=1.0, paths=10_000) -> float:
    """Of the device's mean over the picture from the host's, the largest of the channels."""
    image = furcl.render(scene, device=device)
    assert image.variance is not None
    host = HostRenderer(scene, UNSCATTERED)
    rng = np.random.default_rng(3)
    pixels = [host.pixel(x, y, paths, rng) for x in range(4) for y in range(4)]
    mean = factor * np.mean([pixel[0] for pixel in pixels], axis=0)
    variance = np.sum([pixel[1] for pixel in pixels], axis=0) / 256.0
    variance += image.variance.sum(axis=(0, 1), dtype=np.float64) / 256.0
    found = image.rgb.mean(axis=(0, 1), dtype=np.float64)
    return float(np.abs((found - mean) / np.sqrt(variance)).max())


@pytest.mark.slow
@pytest.mark.statistical
@pytest.mark.parametrize("factor", [1.0, 1.1], ids=["true", "mutant"])
@pytest.mark.parametrize("name", [*ONES, "all in a sky"])
def test_fibres_have_the_light_of_the_host(device, name, factor):
    """Three channels of 8 scenes; 4.1 standard errors are one failure in 1000 families."""
    if name == "all in a sky":
        scene = cross(ONES, {"kind": "sky", "sun_radius_deg": 20.0})
    else:
        scene = cross({name: ONES[name]})
    z = host_z(device, scene, factor)
    assert (z < 4.1) == (factor == 1.0), f"z = {z:.2f}"


def patch(lamps, **render):
    return decode_scene(
        {
            "film": {"width": 24, "height": 16},
            "camera": {"azimuth_deg": -60.0, "elevation_deg": 40.0},
            "fibre": {"preset": "red-fox"},
            "lamp": lamps,
            "curves": {
                "generator": "fur", "surface": "patch", "patch_size": [1.0, 1.0],
                "n_strands": 300, "length": 0.3, "radius": 0.01,
            },
            "render": {"spp": 512, **INDEPENDENT, **render},
        },
        "patch",
    )  # fmt: skip


@pytest.fixture(scope="module")
def by_chance(device):
    """All lamps that rays find, found by rays."""
    lamps = {name: ONES[name] for name in FOUND}
    return furcl.render(patch(lamps, light_sampling="bcsdf", spp=8192, seed=5), device=device)


@pytest.mark.statistical
@pytest.mark.parametrize("choice", ["position", "power"])
def test_light_samples_change_no_mean(device, by_chance, choice):
    """Block by block; 6 % more light must be seen."""
    lamps = {name: ONES[name] for name in FOUND}
    found = furcl.render(patch(lamps, light_sampling="mis", lamp_choice=choice), device=device)
    limit = stats.norm.isf(0.5 * sidak(N_BLOCKS * 2))
    assert np.abs(z_of_blocks(found, by_chance)).max() < limit
    brighter = furcl.Image(found.rgb * np.float32(1.06), found.variance)
    assert np.abs(z_of_blocks(brighter, by_chance)).max() > limit


def box():
    """Six quads of radiance 1 that look inwards, the sides of a box around the scene, turned so
    that no direction is special."""
    turned = Transform(rotate_deg=(20.0, 35.0, 50.0)).as_matrix()
    faces = [(0, 0, 0), (180, 0, 0), (90, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0)]
    sides = {}
    for i, angles in enumerate(faces):
        face = Transform(rotate_deg=angles).as_matrix()
        face[:3, 3] = 4.0 * face[:3, 2]
        matrix = (turned @ face).tolist()
        sides[f"side{i}"] = {
            "kind": "quad", "transform": {"matrix": matrix}, "size": [8, 8], "radiance": 1,
        }  # fmt: skip
    return sides


def furnace(device, seed) -> tuple[float, float]:
    """z of the mean of a clear white patch between six lamps, from 1, and its standard error."""
    scene = with_overrides(
        fur_patch(
            {"sigma_ca": 0.0}, spp=256, roulette_depth=1000, max_depth=200, residual=True,
            light_sampling="mis", seed=seed,
        ),
        ["environment.kind=constant", "environment.radiance=0.0"],
    )  # fmt: skip
    document = {**msgspec.to_builtins(scene), "environment": None, "lamp": box()}
    scene = decode_scene(document, "furnace")
    image = furcl.render(scene, device=device)
    assert image.variance is not None
    error = np.sqrt(image.variance[..., 0].astype(np.float64).sum()) / image.variance[..., 0].size
    return float((image.rgb[..., 0].mean(dtype=np.float64) - 1.0) / error), float(error)


@pytest.mark.statistical
def test_white_fibres_vanish_between_six_lamps(device, seed):
    """A furnace: within 4 standard errors."""
    z, error = furnace(device, seed)
    assert error < 0.001
    assert abs(z) < 4.0


MUTANTS = {
    "light samples are not weighed": (
        r"(towards\.value .*)rival_density\(&chosen, towards\.pdf\)", r"\g<1>0.0f",
        "stages/shade.cl",
    ),
    "rays are not weighed": (
        r"pdf > 0\.0f \? pdf / \(pdf \+ rival\) : 1\.0f", "1.0f", "stages/shade_escaped.cl",
    ),
    "a shadow ray stops at the lamp it goes to": (
        r"path_uint\(paths, PS_SHADOW_LAMP, slot\)", "FURCL_NO_LAMP", "stages/intersect.cl",
    ),
    "a chance is forgotten": (
        r"lamp_chance\(lights, which, origin\) \*", "", "stages/shade_escaped.cl"
    ),
}  # fmt: skip


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", MUTANTS)
def test_mutants_are_seen_in_the_furnace(device, seed, monkeypatch, mutant):
    pattern, text, file = MUTANTS[mutant]
    substitute(monkeypatch, pattern, text, within=file)
    assert abs(furnace(device, seed)[0]) > 8.0


def seen(device, lamps, **tables):
    """A picture of 8 x 8 pixels from (0, -4, 0) along y, with a fibre far aside."""
    scene = decode_scene(
        {
            "film": {"width": 8, "height": 8, "filter": "box"},
            "camera": {"origin": [0, -4, 0], "target": [0, 0, 0], "vfov_deg": 10.0},
            "fibre": {"preset": "human-black"},
            "curves": {"generator": "fibre", "radius": 0.01, "centre": [0, 90, 0]},
            "lamp": lamps,
            "render": {"spp": 4, **INDEPENDENT},
            **tables,
        }
    )
    return furcl.render(scene, device=device).rgb


FACING = {"kind": "quad", "target": [0, -4, 0], "size": [9, 9], "radiance": 3, "colour": [1, 2, 3]}


def test_lamps_are_seen_and_hide_what_is_behind(device):
    """Front, back, a lamp before another, and the environment behind both."""
    red = {**FACING, "position": [0, 2, 0], "colour": [1, 0, 0]}
    near = {**FACING, "position": [0, 1, 0], "size": [0.2, 9.0]}
    sky = {"environment": {"kind": "constant", "radiance": 0.5}}
    np.testing.assert_array_equal(seen(device, {"a": FACING}), np.tile([3.0, 6.0, 9.0], (8, 8, 1)))
    assert not seen(device, {"a": {**FACING, "target": [0, 4, 0]}}, **sky).any()
    both = seen(device, {"a": red, "b": near}, **sky)
    np.testing.assert_array_equal(both[:, 0], np.tile([3.0, 0.0, 0.0], (8, 1)))
    np.testing.assert_array_equal(both[3, 4], [3.0, 6.0, 9.0])
    ball = {"kind": "sphere", "position": [0, 0, 0], "radius": 0.1, "radiance": 2.0}
    aside = seen(device, {"ball": ball}, **sky)
    np.testing.assert_array_equal(aside[0, 0], [0.5] * 3)
    np.testing.assert_array_equal(aside[4, 4], [2.0] * 3)


def test_a_body_before_a_lamp_hides_it(device):
    body = {"body": {"centre": [0, -2, 0], "radii": [1, 1, 1], "albedo": 0.0}}
    assert not seen(device, {"a": FACING}, **body).any()
    behind = {"body": {"centre": [0, 3, 0], "radii": [1, 1, 1], "albedo": 0.0}}
    np.testing.assert_array_equal(seen(device, {"a": FACING}, **behind)[..., 0], 3.0)


def test_a_distant_lamp_is_seen_where_it_has_an_angle(device):
    lamp = {"kind": "distant", "target": [0, -1, 0], "angle_deg": 4.0, "radiance": 7.0}
    found = seen(device, {"sun": lamp})
    np.testing.assert_array_equal(found[4, 4], [7.0] * 3)
    assert not found[0, 0].any()
    point = {"kind": "distant", "target": [0, -1, 0], "angle_deg": 0.0, "irradiance": 7.0}
    assert not seen(device, {"sun": point}).any()


@pytest.mark.parametrize("kind", ["point", "spot", "direction"])
def test_lamps_that_rays_cannot_find_must_be_sampled(device, kind):
    scene = cross({kind: ONES[kind]}, light_sampling="bcsdf")
    name = "distant" if kind == "direction" else kind
    with pytest.raises(SceneError, match=rf"'bcsdf' never finds .*'{name}'; allowed are"):
        Renderer(scene, device)


def test_without_lamps_nothing_of_them_is_compiled(device):
    renderer = Renderer(decode_scene(minimal(render={"light_sampling": "mis"})), device)
    for text in renderer.wavefront.texts():
        assert "LAMP_KIND" not in text
        assert "#define FURCL_LAMPS 1" not in text
        assert "SHADOW_LAMP" not in text.split("enum", 1)[-1].split("}", 1)[0]
