"""Light on meshes: energy, hair on them, colours."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from kernel_mutants import substitute
from mesh_files import obj_text
from mesh_shapes import sphere
from scipy import ndimage

import furcl
from furcl.image.image import Image
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


def alone(file, environment=None, size=16, spp=16, **mesh):
    """A mesh that fills most of the picture, seen from -y, and a strand far away."""
    return decode_scene(
        {
            "camera": {"origin": [0.0, -8.0, 0.0], "target": [0.0, 0.0, 0.0], "vfov_deg": 10.0},
            "film": {"width": size, "height": size, "filter": "box"},
            "fibre": {"preset": "human-black"},
            "environment": environment or {"kind": "constant"},
            "curves": {"generator": "fibre", "radius": 1e-4, "length": 1e-2, "centre": [0, 50, 0]},
            "mesh": {"it": {"file": file, **mesh}},
            "render": {"spp": spp, "sequence": "independent", "roulette": "depth"},
        },
        "alone",
    )


@pytest.mark.parametrize("smooth", [True, False], ids=["smooth", "facets"])
@pytest.mark.parametrize("light_sampling", ["bcsdf", "mis"])
def test_a_convex_mesh_in_even_light_shows_its_albedo(device, tmp_path, light_sampling, smooth):
    """To a bit without light samples, however coarse the mesh is; with them within 5 errors of 768
    values (alpha 4e-4)."""
    albedo = np.array([0.9, 0.5, 0.1])
    scene = alone(ball(tmp_path, 2.0, 5), smooth=smooth, albedo=albedo.tolist(), spp=64)
    scene = with_overrides(scene, [f"render.light_sampling={light_sampling}"])
    image = furcl.render(scene, device=device)
    assert image.variance is not None
    error = np.sqrt(image.variance.astype(np.float64)) if light_sampling == "mis" else 0.0
    assert (np.abs(image.rgb - albedo) <= 5.0 * error + 2e-6).all()


@pytest.mark.statistical
@pytest.mark.parametrize("smooth", [True, False], ids=["smooth", "facets"])
def test_light_samples_of_meshes_change_no_mean(device, tmp_path, smooth):
    """Under a sky, with and without. The mean of three channels within 4.5 errors (alpha 2e-5)."""
    environment = {"kind": "sky", "sun_radius_deg": 20.0}
    scene = alone(ball(tmp_path, 0.6, 6), environment, 12, 1024, smooth=smooth, albedo=0.8)
    with_samples, without = (
        furcl.render(with_overrides(scene, [f"render.light_sampling={word}"]), device=device)
        for word in ("mis", "bcsdf")
    )
    assert with_samples.variance is not None
    assert without.variance is not None
    difference = with_samples.rgb.sum(axis=(0, 1), dtype=np.float64) - without.rgb.sum(axis=(0, 1))
    error = np.sqrt((with_samples.variance + without.variance).sum(axis=(0, 1), dtype=np.float64))
    assert (error < 0.01 * without.rgb.sum(axis=(0, 1))).all()
    assert (np.abs(difference) < 4.5 * error).all()


SQUARE = np.array([[[-1, 0, -1], [1, 0, -1], [1, 0, 1]], [[-1, 0, -1], [1, 0, 1], [-1, 0, 1]]])


def test_a_texture_is_where_its_coordinates_say(device, tmp_path, rng):
    """A square in even light shows its texture, repeated and bilinear. The reference is scipy's."""
    texture = rng.random((4, 6, 3)).astype(np.float32)
    Image(texture).save(tmp_path / "a.exr")
    (tmp_path / "a.obj").write_text(obj_text(SQUARE, places=SQUARE[..., [0, 2]] * 0.7 + 0.4))
    scene = alone(
        str(tmp_path / "a.obj"), texture_file=str(tmp_path / "a.exr"), size=32, albedo=0.5
    )
    scene = with_overrides(scene, ["render.light_sampling=bcsdf", "camera.vfov_deg=14.0"])
    samples = 512
    found = furcl.render(scene, device=device, spp=samples).rgb
    # The mean over a pixel, by 16 x 16 points of it.
    at = (np.arange(512) + 0.5) / 512 * 2.0 - 1.0
    half = 8.0 * np.tan(np.radians(7.0))
    x, z = np.meshgrid(half * at, -half * at)
    row = (1.0 - (0.7 * z + 0.4)) * 4 - 0.5
    column = (0.7 * x + 0.4) * 6 - 0.5
    expected = np.stack(
        [ndimage.map_coordinates(texture[..., c], [row, column], order=1, mode="grid-wrap")
         for c in range(3)], axis=2,
    )  # fmt: skip
    expected = 0.5 * expected.reshape(32, 16, 32, 16, 3).mean(axis=(1, 3))
    assert np.abs(found - expected).max() < 0.02
    assert np.abs(found - expected[::-1]).max() > 0.1


def test_a_mesh_that_emits_is_seen(device, tmp_path):
    """Its fronts add their radiance to what they reflect."""
    scene = alone(ball(tmp_path, 2.0), albedo=0.5, emission=[3.0, 2.0, 1.0])
    image = furcl.render(with_overrides(scene, ["render.light_sampling=bcsdf"]), device=device)
    assert np.allclose(image.rgb, [3.5, 2.5, 1.5], rtol=1e-5)


def test_light_of_a_mesh_falls_on_another(device, tmp_path):
    """A square before a bright one of its size, at half the length of its sides. To the middle of
    such squares belongs a form factor of 4 / pi * atan(1 / sqrt 2) / sqrt 2 (Howell, A catalog of
    radiation heat transfer configuration factors, B-3)."""
    (tmp_path / "lit.obj").write_text(obj_text(SQUARE))
    (tmp_path / "bright.obj").write_text(obj_text(SQUARE + np.array([0, 1, 0])))
    scene = alone(str(tmp_path / "lit.obj"), {"kind": "constant", "radiance": 1e-7}, 4, 16384)
    scene = with_overrides(
        scene,
        [
            "camera.origin=[0, 0.5, 0]", "camera.target=[0, 0, 0]", "camera.up=[0, 0, 1]",
            "camera.vfov_deg=0.5", "mesh.it.albedo=0.6", "render.light_sampling=bcsdf",
            f"mesh.bright.file={tmp_path / 'bright.obj'}", "mesh.bright.emission=2.0",
            "mesh.bright.albedo=0.0",
        ],
    )  # fmt: skip
    mean, error = mean_and_error(furcl.render(scene, device=device))
    factor = 4.0 / np.pi * np.arctan(1.0 / np.sqrt(2.0)) / np.sqrt(2.0)
    assert error < 2e-3
    assert abs(mean - 0.6 * 2.0 * factor) < 4.0 * error


def lit_by(tmp_path, light_sampling, **changes):
    """A grey square below a bright ball of few triangles, with a strand between: the ball is all
    the light that there is."""
    (tmp_path / "floor.obj").write_text(obj_text(3.0 * SQUARE[..., [0, 2, 1]][:, ::-1]))
    (tmp_path / "bright.obj").write_text(
        obj_text(sphere(5, 0.6).corners + np.array([0.2, 0.1, 1.3]))
    )
    document = {
        "camera": {"origin": [0.0, -8.0, 5.0], "target": [0.0, 0.0, 0.0], "vfov_deg": 24.0},
        "film": {"width": 12, "height": 8, "filter": "box"},
        "fibre": {"preset": "blond"},
        "curves": {
            "generator": "fibre", "count": 5, "axis": "x", "radius": 0.06, "length": 2.0,
            "spacing": 0.3, "centre": [0.0, 0.0, 0.3],
        },
        "mesh": {
            "floor": {"file": str(tmp_path / "floor.obj"), "albedo": 0.6},
            "bright": {
                "file": str(tmp_path / "bright.obj"), "emission": [6.0, 4.0, 2.0], "albedo": 0.3,
            },
        },
        "render": {
            "spp": 512, "sequence": "independent", "roulette": "depth", "max_depth": 3,
            "light_sampling": light_sampling,
        },
    }  # fmt: skip
    return with_overrides(decode_scene(document, "lit"), [], **changes)


@pytest.fixture(scope="module")
def found_by_rays(device, tmp_path_factory):
    """The scene of `lit_by` without light samples."""
    return furcl.render(lit_by(tmp_path_factory.mktemp("lit"), "bcsdf", spp=4096), device=device)


def z_from(image, reference):
    """Of the sums of three channels over two parts of a picture below the lamp, the largest."""
    found = [image.rgb.astype(np.float64), image.variance, reference.rgb, reference.variance]
    mean, variance, other, other_variance = (
        values[4:].reshape(2, 2, 12, 3).sum(axis=(1, 2), dtype=np.float64) for values in found
    )
    return float((np.abs(mean - other) / np.sqrt(variance + other_variance)).max())


@pytest.mark.statistical
@pytest.mark.parametrize("choice", ["position", "power"])
def test_light_samples_of_a_bright_mesh_change_no_mean(device, tmp_path, found_by_rays, choice):
    """Six sums within 4.5 errors (alpha 8e-5 for both); 10 % more light is seen. Most pixels of the
    floor have at most a third of the variance at equal samples."""
    scene = with_overrides(lit_by(tmp_path, "mis"), [f"render.lamp_choice={choice}"])
    image = furcl.render(scene, device=device)
    assert z_from(image, found_by_rays) < 4.5
    assert z_from(Image(image.rgb * np.float32(1.1), image.variance), found_by_rays) > 4.5
    assert image.variance is not None
    assert found_by_rays.variance is not None
    assert np.median(image.variance[4:] / found_by_rays.variance[4:]) < 8.0 / 3.0


EMISSION_MUTANTS = {
    "rays are not weighed": (
        r"return weight_of_lamp\(light, at->lamp, density, origin, pdf\) \*", "return",
        "stages/shade_surface.cl",
    ),
    "another triangle": (
        r"material\.lamps \+ first / 3u", "material.lamps + (first / 3u) / 2u",
        "stages/shade_surface.cl",
    ),
    "a chance is forgotten": (
        r"lamp_chance\(lights, which, origin\) \*", "", "stages/shade_surface.cl"
    ),
    "shadow rays meet the lamp": (r"TRIANGLE_MARGIN \* size", "-1e-3f * size", "stages/shade.cl"),
}  # fmt: skip


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", EMISSION_MUTANTS)
def test_wrong_light_of_a_bright_mesh_is_seen(device, tmp_path, monkeypatch, found_by_rays, mutant):
    pattern, text, file = EMISSION_MUTANTS[mutant]
    substitute(monkeypatch, pattern, text, within=file)
    image = furcl.render(lit_by(tmp_path, "mis"), device=device)
    assert z_from(image, found_by_rays) > 6.0


@pytest.mark.statistical
def test_a_bright_square_lights_like_a_lamp(device, tmp_path):
    """Two triangles, black and bright on one side, and a quad of the same place and radiance."""
    base = lit_by(tmp_path, "mis")
    square = 0.5 * SQUARE[..., [0, 2, 1]][:, ::-1] + np.array([0.0, 0.0, 1.0])
    (tmp_path / "square.obj").write_text(obj_text(square))
    mesh = with_overrides(
        base, [f"mesh.bright.file={tmp_path / 'square.obj'}", "mesh.bright.albedo=0.0"]
    )
    document = msgspec.to_builtins(base)
    del document["mesh"]["bright"]
    document["lamp"] = {
        "quad": {"kind": "quad", "position": [0, 0, 1], "size": [1, 1], "radiance": 1.0,
                 "colour": [6.0, 4.0, 2.0]},
    }  # fmt: skip
    images = [furcl.render(scene, device=device) for scene in (mesh, decode_scene(document, "q"))]
    assert z_from(*images) < 4.5
    assert z_from(Image(images[0].rgb * np.float32(1.06), images[0].variance), images[1]) > 4.5


def test_layers_show_where_a_mesh_is(device, tmp_path):
    """Means over the middle's pixels, which are 0.09 wide on a ball of radius 2."""
    scene = alone(ball(tmp_path, 2.0, 96), spp=4)
    layers = furcl.render(
        with_overrides(scene, ["film.layers=['depth', 'position']"]), device=device
    ).layers
    x, y, z, depth = (layers[name][6:10, 6:10] for name in (*(f"P.{c}" for c in "XYZ"), "Z"))
    assert (np.abs(np.sqrt(x * x + y * y + z * z) - 2.0) < 0.01).all()
    assert (np.abs(y + 8.0 - depth) < 1e-4).all()
