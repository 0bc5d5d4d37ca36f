"""Pictures of what moves: a camera that goes along, and the mean of many still ones."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_mutants import substitute
from scene_documents import INDEPENDENT
from scipy import stats

from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene, with_overrides

CLEAR = {"preset": "human-black", "kappa": 0.0, "beta_n_deg": 20.0, "sigma_ca": 0.3}
TUFT = {
    "generator": "fur", "surface": "patch", "n_strands": 40, "length": 0.5, "radius": 0.03,
    "patch_size": [0.5, 0.5], "lean_deg": 20.0,
}  # fmt: skip
WAY = (0.0, 0.7, 0.2)
# The times of keys are uneven, and so is the way: what takes one for the other is seen.
MOMENTS = {0.0: 0.0, 0.3: 0.6, 1.0: 1.0}
LAYERS = ["alpha", "depth", "strand", "strand_u"]


def along(place, part):
    return [x + part * y for x, y in zip(place, WAY, strict=True)]


def document():
    """A tuft that moves, a lamp and a camera that can, 8 x 6 pixels; the shutter is open for it
    all."""
    return {
        "camera": {
            "origin": [4.0, 0.0, 1.0], "target": [0.0, 0.0, 0.2], "vfov_deg": 22.0,
            "shutter": [0.0, 1.0],
        },
        "film": {"width": 8, "height": 6, "filter": "box", "layers": LAYERS},
        "fibre": CLEAR,
        "groom": {
            "tuft": {
                "curves": TUFT,
                "keys": [
                    {"time": time, "translate": along((0, 0, 0), part)}
                    for time, part in MOMENTS.items()
                ],
            },
        },
        "environment": {"kind": "constant", "radiance": 0.5},
        "lamp": {"key": {"kind": "distant", "angle_deg": 5, "target": [0.3, 1.0, -1.0],
                         "irradiance": 3.0}},
        "render": {"max_depth": 4, **INDEPENDENT},
    }  # fmt: skip


def tracking(scene):
    """The camera goes with the tuft."""
    camera = scene["camera"]
    keys = [
        {"time": time, "origin": along(camera["origin"], part),
         "target": along(camera["target"], part)}
        for time, part in MOMENTS.items()
    ]  # fmt: skip
    return {**scene, "camera": {**camera, "keys": keys}}


def swaying(scene):
    """The tuft turns as well and another one stands still in front of its shadow; the camera goes
    a way of its own."""
    tuft = scene["groom"]["tuft"]
    keys = [
        {**key, "rotate_deg": [turn, 0, -turn / 2]}
        for key, turn in zip(tuft["keys"], (0.0, 2.0, 0.0), strict=True)
    ]
    still = {"curves": {**TUFT, "seed": 2}, "transform": {"translate": [0.2, 0.9, -0.1]}}
    camera = scene["camera"]
    ways = [
        {"time": time, "origin": [4.0, 0.3 * part, 1.0], "target": [0.0, 0.3, 0.2 - 0.2 * part]}
        for time, part in MOMENTS.items()
    ]
    return {
        **scene,
        "groom": {"tuft": {**tuft, "keys": keys}, "still": still},
        "camera": {**camera, "keys": ways},
    }


def render(device, scene, spp, *overrides):
    renderer = Renderer(with_overrides(decode_scene(scene), overrides), device)
    renderer.advance(spp)
    return renderer.image()


SAMPLES = 64


def tracked_share(device, still):
    """Pixels and layers in which a tuft seen by a camera that goes along differs from one that
    keeps still seen by one that does, with the same random numbers."""
    image = render(device, tracking(document()), SAMPLES)
    values = [(image.rgb, still.rgb)] + [(image.layers[k], still.layers[k]) for k in still.layers]
    scale = [np.abs(b).max() + 1e-6 for _, b in values]
    differ = [np.abs(a - b) > 2e-3 * s for (a, b), s in zip(values, scale, strict=True)]
    return float(np.mean(np.concatenate([d.ravel() for d in differ])))


@pytest.fixture(scope="module")
def kept_still(device):
    return render(device, document(), SAMPLES, "camera.shutter=[0,0]")


def test_what_the_camera_goes_along_with_is_not_blurred(device, kept_still):
    """To the rounding of places, which may send a path elsewhere (measured: no value differs)."""
    assert tracked_share(device, kept_still) < 0.05


def test_camera_and_groom_at_different_times_are_seen(device, kept_still, monkeypatch):
    """Mutant: the camera has another random time than the groom (measured: 34 % differ)."""
    pattern = r"moved_camera\(&camera, shutter, lane\(&parts\.x, k\)\)"
    substitute(
        monkeypatch, pattern, "moved_camera(&camera, shutter, lane(&parts.y, k))",
        within="stages/generate.cl",
    )  # fmt: skip
    assert tracked_share(device, kept_still) > 0.2


N_STILLS, STILL_SAMPLES, MOVING_SAMPLES = 24, 96, 1536
ALPHA = 1e-4


@pytest.fixture(scope="module")
def mean_of_stills(device):
    """Mean and variance of still pictures in the middles of equal parts of the shutter's time; of
    the ways that pixels see, a part is less than a quarter of a pixel."""
    scene, mean, variance = swaying(document()), 0.0, 0.0
    for i in range(N_STILLS):
        time = (i + 0.5) / N_STILLS
        image = render(
            device, scene, STILL_SAMPLES, f"camera.shutter=[{time},{time}]", f"render.seed={i + 1}"
        )
        mean = mean + image.rgb.astype(np.float64) / N_STILLS
        assert image.variance is not None
        variance = variance + image.variance.astype(np.float64) / N_STILLS**2
    return mean, variance


def largest_z(device, reference):
    mean, variance = reference
    image = render(device, swaying(document()), MOVING_SAMPLES)
    assert image.stats["nonfinite"] == 0
    error = np.sqrt(variance + image.variance + 1e-12)
    # Channels of a grey scene are alike.
    return float(np.abs((image.rgb - mean) / error)[..., 0].max())


def bound(n_pixels=48):
    return float(stats.norm.isf(ALPHA / (2 * n_pixels)))


@pytest.mark.statistical
@pytest.mark.slow
def test_pictures_are_the_mean_of_still_ones(device, mean_of_stills):
    """48 pixels, Bonferroni at 1e-4 in all."""
    assert largest_z(device, mean_of_stills) < bound()


MUTANTS = {
    "the time is the place on the film": (r"DIM_TIME\);", "DIM_FILM);"),
    "times of keys are even": (r"return in_steps\(shutter, FURCL_MOTION, part\)",
                               "return part * FURCL_MOTION"),
}  # fmt: skip


@pytest.mark.statistical
@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_mutants_are_seen(device, mean_of_stills, monkeypatch, name):
    """Measured: at least 8.5 errors in some pixel; the bound is 4.7."""
    substitute(monkeypatch, *MUTANTS[name], within="stages/generate.cl")
    assert largest_z(device, mean_of_stills) > 1.5 * bound()


@pytest.mark.statistical
@pytest.mark.slow
def test_a_forgotten_key_is_seen(device, mean_of_stills, monkeypatch):
    """Mutant: the tuft goes straight from the first key to the last."""
    from furcl.scene import groom

    monkeypatch.setattr(groom, "key_times", lambda keys: [keys[0].time, keys[-1].time])
    assert largest_z(device, mean_of_stills) > 1.5 * bound()
