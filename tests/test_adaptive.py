"""Renders whose pixels take different numbers of samples."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_lines import run
from scene_documents import fur_patch

import furcl
from furcl.errors import ImageError, SceneError
from furcl.rendering.renderer import Renderer
from furcl.scene.read import with_overrides


def _render(*arguments: Any, **keywords: Any) -> Any:
    """A picture, of which this file knows that it has samples and variance."""
    return furcl.render(*arguments, **keywords)


def _image(renderer: Renderer) -> Any:
    return renderer.image()


def _load(path: Path) -> Any:
    return furcl.Image.load(path)


def _scene(size=(24, 16), **render):
    fibre = {"preset": "human-black"}
    scene = fur_patch(fibre, allocation="adaptive", light_sampling="mis", **{"spp": 20, **render})
    return with_overrides(scene, size=size)


def _bits(image):
    return image.rgb.tobytes(), image.variance.tobytes(), image.samples.tobytes()


def _check_pixels_are_those_of_even_renders(image, scene, device):
    """A pixel with n samples has the bits that n samples have in a render that gives all n."""
    even = Renderer(with_overrides(scene, ["render.allocation=even"]), device)
    for n in np.unique(image.samples):
        even.advance(int(n) - even.samples_done)
        same = image.samples == n
        expected = _image(even)
        assert np.array_equal(image.rgb[same], expected.rgb[same])
        assert np.array_equal(image.variance[same], expected.variance[same])


@pytest.mark.parametrize("size", [(24, 16), (7, 13), (1, 9), (1, 1)])
def test_pixels_have_the_bits_of_even_renders(device, size):
    """In strips of eight rows, in the rest of them, and without a neighbour."""
    scene = _scene(size)
    image = _render(scene, device=device)
    assert image.samples.sum() == 20 * size[0] * size[1]
    assert image.samples.min() >= 4
    assert image.stats["samples"] == {"min": image.samples.min(), "max": image.samples.max()}
    assert image.stats["complete"]
    _check_pixels_are_those_of_even_renders(image, scene, device)


def test_wave_size_changes_no_bit(device):
    """Nor do the debug checks find anything: waves begin and end within a pixel's samples."""
    images = [_render(_scene(), device=device, wave_size=n) for n in (1 << 18, 1000, 37)]
    assert _bits(images[0]) == _bits(images[1]) == _bits(images[2])
    assert images[0].stats["steps"] == images[1].stats["steps"] > 2


def test_indices_stay_inside(device, monkeypatch):
    monkeypatch.setenv("FURCL_DEBUG", "1")
    renderer = Renderer(_scene(spp=8), device, wave_size=500)
    assert renderer.advance(8)
    assert _image(renderer).samples.sum() == 24 * 16 * 8


def test_a_render_that_is_stopped_goes_on(device):
    """Stopped within a step, pixels have the numbers that the film says, and the rest follows."""
    scene = _scene()
    renderer = Renderer(scene, device, wave_size=333)
    assert not renderer.advance(20, progress=lambda done, total: done > total / 2)
    stopped = _image(renderer)
    assert stopped.samples.sum() == renderer.paths_done < 20 * 24 * 16
    _check_pixels_are_those_of_even_renders(stopped, scene, device)
    left = 20 * 24 * 16 - renderer.paths_done
    assert renderer.advance(left // (24 * 16))
    image = _image(renderer)
    assert image.samples.sum() == renderer.paths_done
    _check_pixels_are_those_of_even_renders(image, scene, device)


def test_a_render_that_starts_again_is_the_same(device):
    renderer = Renderer(_scene(), device)
    renderer.advance(20)
    first = _image(renderer)
    renderer.restart(renderer.scene.render.seed + 1)
    renderer.advance(20)
    assert _bits(_image(renderer)) != _bits(first)
    renderer.restart(renderer.scene.render.seed - 1)
    renderer.advance(20)
    assert _bits(_image(renderer)) == _bits(first)


def test_a_plan_of_equal_numbers_is_an_even_render(device):
    """Which the build with everything is."""
    scene = with_overrides(_scene(), ["render.allocation=even"])
    lean, full = (Renderer(scene, device, specialised=flag) for flag in (True, False))
    assert lean.plan is None
    assert full.plan is not None
    for renderer in (lean, full):
        assert renderer.advance(20)
        assert np.all(_image(renderer).samples == 20)
    assert lean.rays == pytest.approx(full.rays, rel=1e-3)


def test_samples_go_where_errors_are(device):
    """More of them, and a smaller error in all for as many: measured 0.70 of the even MSE."""
    scene = _scene(spp=64)
    image = _render(scene, device=device)
    even = _render(with_overrides(scene, ["render.allocation=even"]), device=device)
    deviation = np.sqrt(even.variance.mean(axis=2))
    noisy = deviation > np.median(deviation)
    assert image.samples[noisy].mean() > 1.5 * image.samples[~noisy].mean()
    ratio = image.stats["error"]["rmse"]["estimate"] / even.stats["error"]["rmse"]["estimate"]
    assert ratio**2 < 0.85


@pytest.mark.parametrize("allocation", ["even", "adaptive"])
def test_a_target_ends_a_render(device, allocation):
    """The estimate is near it; samples that were asked for limit it."""
    scene = with_overrides(_scene(), [f"render.allocation={allocation}"])
    spent = {}
    for target in (0.02, 0.01):
        image = _render(scene, device=device, target_rmse=target)
        assert image.stats["complete"]
        assert image.stats["target"] == {"rmse": target}
        error = image.stats["error"]["rmse"]
        assert error["estimate"] == pytest.approx(target, rel=0.15)
        assert error["low"] < error["estimate"] < error["high"]
        spent[target] = image.samples.mean()
    assert spent[0.01] > 2.5 * spent[0.02]
    limited = _render(scene, spp=5, device=device, target_rmse=1e-6)
    assert not limited.stats["complete"]
    assert limited.samples.mean() == 5
    relative = _render(scene, device=device, target_relmse=0.02)
    assert relative.stats["error"]["relmse"]["estimate"] == pytest.approx(0.02, rel=0.3)


@pytest.mark.parametrize(
    ("keywords", "what"),
    [({}, "render.allocation = 'adaptive'"), ({"target_rmse": 0.1}, "a target error")],
)
def test_a_plan_without_variance_is_refused(device, keywords, what):
    scene = _scene(variance=False)
    with pytest.raises(SceneError, match=f"variance = false: {what} needs the variance; set it"):
        _render(scene, device=device, **keywords)


def test_maps_are_layers_of_the_file(device, tmp_path):
    image = _render(_scene(), device=device)
    image.save(tmp_path / "out.exr")
    again = _load(tmp_path / "out.exr")
    assert np.array_equal(again.samples, image.samples)
    assert np.array_equal(again.standard_error, image.standard_error)
    expected = np.sqrt(image.variance.astype(np.float64).mean(axis=2))
    np.testing.assert_allclose(image.standard_error, expected, rtol=1e-6)
    from furcl.image.exr import read_exr

    channels, _ = read_exr(tmp_path / "out.exr")
    np.testing.assert_array_equal(channels["error"], image.standard_error)
    _render(fur_patch(), device=device).save(tmp_path / "even.exr")
    assert _load(tmp_path / "even.exr").samples is None
    with pytest.raises(ImageError, match="samples has the shape"):
        furcl.Image(image.rgb, samples=image.samples[1:])


def test_the_command_line_takes_targets(device, tmp_path, capsys):
    out, stats = tmp_path / "out.exr", tmp_path / "stats.json"
    options = ["--size", "16x16", "--target-rmse", 0.1, "--stats", stats]
    options += ["--set", "render.allocation=adaptive", "--set", "curves.n_strands=300"]
    assert run("render", "white_hair", "-o", out, "--device", device.name, *options) == 0
    assert "reached rmse 0.0" in capsys.readouterr().err
    assert json.loads(stats.read_text())["target"] == {"rmse": 0.1}
    options += ["--spp", 4]
    options[3] = 1e-5
    assert run("render", "white_hair", "-o", out, "--device", device.name, *options) == 0
    assert "stopped early at rmse" in capsys.readouterr().err
    assert run("render", "white_hair", "-o", out, *options, "--target-relmse", 1) != 0
    assert "are two targets" in capsys.readouterr().err
