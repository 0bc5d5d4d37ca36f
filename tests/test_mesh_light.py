"""Light on meshes: energy, hair on them, colours."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_mutants import substitute
from mesh_files import obj_text
from mesh_shapes import sphere

import furcl
from furcl.scene.read import decode_scene, with_overrides

WHITE = {"preset": "human-white", "sigma_ca": 0.0, "sigma_ma": 0.0}


def ball(tmp_path, radius, n=24):
    """A file of a ball."""
    path = tmp_path / "ball.obj"
    path.write_text(obj_text(sphere(n, radius).corners))
    return str(path)


def furnace(file, n_strands=10_000, **mesh):
    """White fur on a mesh in white light."""
    return decode_scene(
        {
            "camera": {"azimuth_deg": -60.0, "elevation_deg": 35.0},
            "film": {"width": 32, "height": 32},
            "fibre": WHITE,
            "environment": {"kind": "constant"},
            "curves": {
                "generator": "fur", "n_strands": n_strands, "length": 0.2, "radius": 0.01,
                "clumping": 0.0, "seed": 4,
            },
            "mesh": {"skin": {"file": file, "albedo": 1.0, **mesh}},
            "render": {
                "spp": 320, "residual": True, "max_depth": 2000, "roulette": "depth",
                "roulette_depth": 2000, "sequence": "independent", "light_sampling": "bcsdf",
            },
        },
        "furnace",
    )  # fmt: skip


def mean_and_error(image):
    """The mean of a grey picture and its standard error, by the variance that the film keeps."""
    values = image.rgb[..., 0].astype(np.float64)
    return values.mean(), np.sqrt(image.variance[..., 0].sum(dtype=np.float64)) / values.size


@pytest.mark.statistical
@pytest.mark.parametrize("smooth", [True, False], ids=["smooth", "facets"])
@pytest.mark.parametrize("radius", [0.995, 1.0, 1.02], ids=["roots above", "roots on", "roots in"])
def test_white_mesh_under_white_fur_disappears(device, tmp_path, radius, smooth):
    """The mean is 1 within 0.1 %, and its standard error is below a quarter of that."""
    scene = furnace(ball(tmp_path, radius), smooth=smooth)
    image = furcl.render(scene, device=device)
    mean, error = mean_and_error(image)
    assert image.stats["hits_per_path"] > 1.0
    assert image.stats["path_length"] > image.stats["hits_per_path"] + 1.2
    assert error < 2.5e-4
    assert abs(mean - 1.0) < 1e-3


def flat_fur(file):
    """White fur that lies on a mesh, in which the axes of many of its segments are."""
    fur = {
        "lean_deg": 85.0,
        "bend_deg": 5.0,
        "comb_noise_deg": 40.0,
        "frizz": 0.0,
        "undercoat": 0.0,
    }
    scene = furnace(file, n_strands=5000)
    return with_overrides(scene, [f"curves.{k}={v}" for k, v in fur.items()], max_depth=100)


@pytest.mark.statistical
@pytest.mark.parametrize("radius", [1.0, 1.005, 1.01, 1.02])
def test_hair_that_sinks_into_a_mesh_loses_no_light(device, tmp_path, radius):
    """Strands lie half in the mesh: rays from their axes begin below it."""
    mean, error = mean_and_error(furcl.render(flat_fur(ball(tmp_path, radius, 48)), device=device))
    assert error < 2.5e-4
    assert abs(mean - 1.0) < 1e-3


def test_a_fibre_that_sees_what_it_is_below_loses_light(device, tmp_path, monkeypatch):
    """The mutant of the test above. Measured: the mean is 0.987."""
    pattern = r"return 2\.0f \* fmax\(vertex_at"
    substitute(monkeypatch, pattern, "return 0.0f * fmax(vertex_at", within="stages/intersect.cl")
    mean, _ = mean_and_error(furcl.render(flat_fur(ball(tmp_path, 1.01, 48)), device=device))
    assert mean < 1.0 - 5e-3
