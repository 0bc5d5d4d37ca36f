"""Whole renders: determinism, analytic radiance, agreement of samplers and of light sampling."""

import json
from concurrent.futures import Future

import numpy as np
import pytest
from direction_statistics import sidak
from model_checks import SAMPLERS, check_picture_shows_albedo, furnace_z
from scene_documents import fur_patch, single_fibre
from scipy import stats

import furcl
from furcl import bcsdf
from furcl.device import layout
from furcl.errors import GroomError
from furcl.paths import scene_folder
from furcl.rendering.renderer import Renderer
from furcl.scene.read import with_overrides


def _bits(image):
    return image.rgb.tobytes(), image.variance.tobytes()


def test_scenes_that_come_with_furcl_are_rendered_by_name(device):
    named = furcl.render("single_fibre", spp=1, device=device)
    given = furcl.render(furcl.load_scene("single_fibre", spp=1), device=device)
    assert _bits(named) == _bits(given)
    assert named.stats["scene"] == "single_fibre"


@pytest.mark.parametrize("light_sampling", ["bcsdf", "mis"])
def test_wave_size_changes_no_bit(device, light_sampling):
    scene = fur_patch(light_sampling=light_sampling)
    images = [
        furcl.render(scene, device=device, wave_size=size) for size in (1 << 12, 1 << 18, 100)
    ]
    assert _bits(images[0]) == _bits(images[1]) == _bits(images[2])
    assert images[0].stats["nonfinite"] == 0
    for count in ("rays", "path_length", "lobes"):
        assert images[0].stats[count] == images[1].stats[count] == images[2].stats[count]


def test_the_host_is_one_bounce_ahead(device, monkeypatch):
    """A bounce is launched over what the one before began with; one bounce more than needed."""
    renderer = Renderer(fur_patch(light_sampling="mis"), device)
    wavefront = renderer.wavefront
    launched, began = [], []
    intersect = wavefront.intersect_closest

    def record(wave, active):
        launched.append(active)
        n = wavefront.active_counts.size // 4
        counts = renderer.memory.read(wavefront.active_counts, n, np.uint32)
        began.append(int(counts[layout.COUNT_NEXT]))
        intersect(wave, active)

    monkeypatch.setattr(wavefront, "intersect_closest", record)
    renderer.advance(8)
    assert launched == [began[0], *began[:-1]]
    assert began[0] == 24 * 16 * 8
    assert began[-1] == 0
    assert began[-2] > 0
    assert renderer.rays - renderer.shadow_rays == sum(began)
    assert sum(renderer.lobes.values()) > 0


def test_a_render_cut_in_two_is_the_same(device):
    scene = fur_patch(spp=64)
    renderer = Renderer(scene, device)
    assert renderer.advance(16)
    assert renderer.advance(48)
    assert renderer.samples_done == 64
    assert _bits(renderer.image()) == _bits(furcl.render(scene, device=device))


def test_a_groom_on_its_way_is_waited_for(device):
    """And what it is decides what is compiled: all points of this one have one radius."""
    scene = furcl.load_scene(scene_folder() / "single_fibre.toml", size=(8, 8), spp=2)
    groom = Future()
    groom.set_result(scene.build_curves())
    renderer = Renderer(scene, device, curves=groom)
    assert not renderer.features.point_radii
    renderer.advance(2)
    np.testing.assert_array_equal(renderer.image().rgb, furcl.render(scene, device=device).rgb)


def test_a_groom_that_fails_on_its_way_fails_the_render(device):
    groom = Future()
    groom.set_exception(GroomError("no strands"))
    with pytest.raises(GroomError, match="no strands"):
        furcl.render(fur_patch(), device=device, curves=groom)


def test_seeds_differ(device):
    one, two = (furcl.render(fur_patch(), seed=seed, device=device) for seed in (1, 2))
    assert not np.array_equal(one.rgb, two.rgb)


THETAS_DEG = (0.0, 45.0, 75.0)
FIBRES = {
    "black": {"preset": "human-black"},
    "fox": {"preset": "red-fox"},
    "coloured": {
        "kappa": 0.5,
        "sigma_ms": 2.0,
        "sigma_ma": [0.0, 0.1, 0.5],
        "sigma_ca": [0.1, 0.3, 1.0],
    },
}


@pytest.mark.statistical
@pytest.mark.parametrize("sampling", SAMPLERS)
@pytest.mark.parametrize("name", FIBRES)
@pytest.mark.parametrize("theta_deg", THETAS_DEG)
def test_single_fibre_shows_its_albedo(device, seed, theta_deg, name, sampling):
    """By float64 quadrature."""
    scene = single_fibre(theta_deg, FIBRES[name], sampling=sampling, seed=seed)
    fibre = scene.build_fibre()
    check_picture_shows_albedo(
        scene, device, lambda profiles: bcsdf.albedo(fibre, np.deg2rad(theta_deg), profiles)
    )


@pytest.mark.statistical
@pytest.mark.parametrize("light_sampling", [pytest.param("bcsdf", marks=pytest.mark.slow), "mis"])
@pytest.mark.parametrize("preset", ["human-black", "red-fox"])
def test_samplers_agree(device, seed, preset, light_sampling):
    """Means over the picture of every sampler and light sampling against uniform-h alone."""
    base = with_overrides(fur_patch(spp=256), [f"fibre.preset={preset}"], seed=seed)
    reference = furcl.render(base, sampling="uniform-h", device=device)
    level = sidak(2 * 2 * 3)
    for sampling in SAMPLERS:
        scene = with_overrides(base, [f"render.light_sampling={light_sampling}"], seed=seed + 1)
        image = furcl.render(scene, sampling=sampling, device=device)
        assert _mean_p(image, reference) > level, sampling
        wrong = furcl.Image(image.rgb * np.float32(1.1), image.variance)
        assert _mean_p(wrong, reference) < level, f"{sampling}, 10 % too bright"


def _mean_p(a, b):
    """p-value of the z-test that two pictures have the same mean luminance."""
    n = a.width * a.height * 3
    difference = a.rgb.mean(dtype=np.float64) - b.rgb.mean(dtype=np.float64)
    # Channels of a pixel are correlated: three times the variance of independent ones bounds it.
    variance = 3 * (a.variance.sum(dtype=np.float64) + b.variance.sum(dtype=np.float64)) / n**2
    return 2 * stats.norm.sf(abs(difference) / np.sqrt(variance))


@pytest.mark.statistical
def test_roulette_changes_no_mean(device, seed):
    plain = furcl.render(fur_patch(spp=256, roulette_depth=1000, seed=seed), device=device)
    early = furcl.render(fur_patch(spp=256, roulette_depth=0, seed=seed + 1), device=device)
    assert early.stats["rays"] < plain.stats["rays"]
    assert _mean_p(plain, early) > 0.01
    wrong = furcl.Image(early.rgb * np.float32(1.01), early.variance)
    assert _mean_p(plain, wrong) < 0.01, "1 % too bright"
    assert not plain.stats["features"]["compiled"]["roulette"]
    assert early.stats["features"]["compiled"]["roulette"]


def test_max_depth_limits_scattering(device):
    """Depth 1 lets a path scatter once: nobody meets a second fibre's lobe."""
    image = furcl.render(fur_patch(), max_depth=1, device=device)
    assert 0 < sum(image.stats["lobes"].values()) <= image.stats["paths"]
    deep = furcl.render(fur_patch(), max_depth=200, device=device)
    assert deep.rgb.mean() > image.rgb.mean()


# Weights that spread take long paths and many samples.
SLOWLY = pytest.param("attenuation-cdf", 0.5, marks=pytest.mark.slow)


@pytest.mark.statistical
@pytest.mark.parametrize(("sampling", "sigma_ca"), [SLOWLY, ("full-cdf", 0.03)])
def test_white_fur_vanishes_in_a_furnace(device, seed, sampling, sigma_ca):
    """Nothing absorbs and the residual lobe closes the energy: the picture's mean is 1 within 4
    standard errors. Mutant: a cortex that absorbs."""
    scene = with_overrides(
        fur_patch(spp=32, residual=True, roulette_depth=1000, sampling=sampling),
        ["environment={kind='constant', radiance=1.0}", "fibre.sigma_ma=0.0"],
        seed=seed,
    )
    assert abs(furnace_z(with_overrides(scene, ["fibre.sigma_ca=0.0"]), device)) < 4.0
    assert furnace_z(with_overrides(scene, [f"fibre.sigma_ca={sigma_ca}"]), device) < -4.0


def test_stats_have_what_is_promised(device):
    stats = furcl.render(fur_patch(), device=device).stats
    for key in ("device", "driver", "seed", "spp", "sampling", "paths", "rays", "mrays_s", "lobes"):
        assert key in stats
    assert set(stats["features"]) == {"compiled", "left_out"}
    assert {"bvh", "tables", "compile", "render"} <= set(stats["seconds"])
    assert {"host_peak", "device_peak", "bvh", "tables"} <= set(stats["bytes"])
    assert list(stats["lobes"]) == ["R", "TT", "TRT", "TTs", "TRTs"]
    assert stats["paths"] == 24 * 16 * 8
    assert stats["nonfinite"] == 0
    json.dumps(stats)


def test_hair_without_medulla_says_that_scattered_lobes_are_left_out(device):
    scene = with_overrides(fur_patch(), ["fibre.kappa=0.0"])
    stats = furcl.render(scene, device=device).stats
    assert not stats["features"]["compiled"]["scattered"]
    assert "TTs" in stats["features"]["left_out"]["scattered"]
    assert stats["lobes"]["TTs"] == stats["lobes"]["TRTs"] == 0


def test_time_limit_ends_cleanly(device):
    image = furcl.render(fur_patch(spp=4096), time_limit=0.0, device=device, wave_size=64)
    assert image.stats["complete"] is False
    assert image.stats["paths"] == 0


def test_progress_can_stop(device):
    seen = []

    def progress(done, total):
        seen.append((done, total))
        return len(seen) == 3

    image = furcl.render(fur_patch(spp=64), progress=progress, device=device, wave_size=384)
    assert seen == [(384, 24576), (768, 24576), (1152, 24576)]
    assert image.stats["complete"] is False
    assert image.stats["spp"] == 3
    assert np.all(np.isfinite(image.rgb))
