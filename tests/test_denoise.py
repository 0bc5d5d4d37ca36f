"""Denoised previews: less noise, labelled, and refused where numbers are taken from pictures."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from typer.testing import CliRunner

from furcl.cli import app
from furcl.errors import BenchError, ImageError
from furcl.image import denoise
from furcl.image.denoise import denoised
from furcl.image.image import Image
from furcl.image.merge import merged

WITH = pytest.mark.skipif(
    find_spec("pyoidn") is None,
    reason="Open Image Denoise is an extra",
)
N = 64


def noisy(rng, **layers):
    """A smooth picture of two halves, with noise of 0.15, and that picture."""
    truth = np.full((N, N, 3), 0.5, np.float32)
    truth[:, N // 2 :] = 0.8
    rgb = np.maximum(truth + 0.15 * rng.standard_normal(truth.shape), 0).astype(np.float32)
    return Image(rgb, np.full_like(rgb, 0.0225), {"spp": 1}, layers=layers), truth


def error(image, truth):
    return float(np.sqrt(np.mean((image.rgb - truth) ** 2)))


@WITH
def test_noise_goes_and_edges_of_the_guides_stay(rng):
    """A fifth of the noise at most is left; with an albedo, less at the edge than without.
    Measured: RMSE 0.018 of 0.148, at the edge 0.019 and 0.032."""
    image, truth = noisy(rng)
    plain = denoised(image)
    assert error(plain, truth) < 0.2 * error(image, truth)
    layers = {f"albedo.{c}": truth[:, :, 0] for c in "RGB"}
    layers |= {f"tangent.{c}": np.zeros((N, N), np.float32) for c in "XYZ"}
    layers |= {f"N.{c}": np.full((N, N), 1.0 if c == "Z" else 0.0, np.float32) for c in "XYZ"}
    guided = denoised(replace(image, layers=layers))
    edge = np.s_[:, N // 2 - 2 : N // 2 + 2]
    assert np.abs(guided.rgb - truth)[edge].mean() < np.abs(plain.rgb - truth)[edge].mean()
    assert "(albedo, normal): biased, a preview" in guided.stats["denoised"]
    assert "(colour alone)" in plain.stats["denoised"]
    assert guided.layers.keys() == layers.keys()


@WITH
def test_the_label_is_in_the_header_and_stays(rng, tmp_path):
    preview = denoised(noisy(rng)[0])
    assert preview.variance is None
    preview.save(tmp_path / "a.exr")
    again = Image.load(tmp_path / "a.exr")
    assert again.stats["denoised"] == preview.stats["denoised"]
    assert b"furcl:denoised" in (tmp_path / "a.exr").read_bytes()
    with pytest.raises(ImageError, match=r"is denoised, so biased"):
        denoised(again)


@pytest.fixture
def preview(rng):
    """What says that it is denoised."""
    image, _ = noisy(rng)
    return replace(image, stats={"spp": 1, "denoised": "by hand"})


def test_merging_refuses(preview, rng):
    with pytest.raises(ImageError, match=r"picture 1: is denoised, so biased.*; merge the renders"):
        merged([noisy(rng)[0], preview])


def test_comparing_refuses_a_reference(preview, rng, tmp_path):
    preview.save(tmp_path / "a.exr")
    noisy(rng)[0].save(tmp_path / "b.exr")
    names = [str(tmp_path / name) for name in ("a.exr", "b.exr")]
    said = CliRunner().invoke(app, ["compare", *names])
    assert said.exit_code == 0
    assert "a.exr: is denoised" in said.output
    said = CliRunner().invoke(app, ["compare", *reversed(names)])
    assert isinstance(said.exception, ImageError)


def test_benchmarks_refuse(preview, tmp_path):
    from furcl.report.convergence import _rendered

    preview.save(tmp_path / "a.exr")
    with pytest.raises(BenchError, match=r"is denoised, so biased.*; run the benchmark again"):
        _rendered(tmp_path / "a.exr")


@WITH
def test_pictures_that_are_not_finite_are_refused(rng):
    image, _ = noisy(rng)
    image.rgb[3, 4, 1] = np.nan
    with pytest.raises(ImageError, match="not finite"):
        denoised(image)


def test_without_the_package_a_message_says_what_to_install(rng, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    with pytest.raises(ImageError, match=r"furcl\[denoise\]"):
        denoised(noisy(rng)[0])
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    command = ["render", "single_fibre", "-o", str(tmp_path / "a.exr"), "--denoise"]
    said = CliRunner().invoke(app, command)
    assert denoise.NEEDED in str(said.exception)  # before the render
    assert not (tmp_path / "a.exr").exists()


@WITH
def test_a_render_has_a_preview_beside_it(device, tmp_path):
    """The picture is the render as ever, to the bit."""
    small = ["--size", "32x32", "--spp", "2"]
    for name, more in (("a", ["--denoise"]), ("b", [])):
        out = str(tmp_path / f"{name}.exr")
        said = CliRunner().invoke(app, ["render", "single_fibre", "-o", out, *small, *more])
        assert said.exit_code == 0, said.output
    a, b = (Image.load(tmp_path / f"{name}.exr") for name in "ab")
    assert np.array_equal(a.rgb, b.rgb)
    assert "denoised" not in a.stats
    preview = Image.load(tmp_path / "a.denoised.exr")
    assert "(albedo, normal)" in json.loads(json.dumps(preview.stats))["denoised"]
    assert (tmp_path / "a.denoised.png").exists()
    said = CliRunner().invoke(app, ["denoise", out, "-o", str(tmp_path / "c.exr")])
    assert said.exit_code == 0, said.output
    assert "(colour alone)" in Image.load(tmp_path / "c.exr").stats["denoised"]


@WITH
def test_every_frame_has_a_preview_beside_it(device, tmp_path):
    out = str(tmp_path / "turn.#.exr")
    command = ["render", "single_fibre", "-o", out, "--size", "32x32", "--spp", "1", "--denoise"]
    said = CliRunner().invoke(app, [*command, "--frames", "0:2", "--orbit", "90"])
    assert said.exit_code == 0, said.output
    for frame in (0, 1):
        preview = Image.load(tmp_path / f"turn.{frame}.denoised.exr")
        assert "(albedo, normal)" in preview.stats["denoised"]
