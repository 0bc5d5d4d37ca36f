"""Samplers by name: registration, and the example of docs/own_sampler.md."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import numpy as np
import pytest

import furcl
from furcl.device.features import Features
from furcl.errors import FurclError, KernelBuildError, SamplerError, SceneError
from furcl.fibre import samplers
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.paths import kernel_folder
from furcl.rendering.probe import Probe
from furcl.scene.read import decode_scene

EXAMPLE = Path(__file__).parents[1] / "bench" / "samplers" / "lobe_cdf.clh"
SCENE = """
[film]
width = 16
height = 16
[fibre]
preset = "human-black"
kappa = 0.0
[environment]
kind = "constant"
[curves]
generator = "fur"
surface = "patch"
n_strands = 200
radius = 0.01
"""


@pytest.fixture
def registered():
    """Register samplers for the length of a test."""
    names = []

    def register(name: str, path: Path, **options) -> samplers.Sampler:
        sampler = samplers.register(name, path, **options)
        names.append(name)
        return sampler

    yield register
    for name in set(names):
        samplers.unregister(name)


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "patch.toml"
    path.write_text(SCENE)
    return path


def _file(name: str) -> Path:
    return kernel_folder() / "include" / samplers.find(name).header


def fibre(**changes) -> Fibre:
    return Fibre.preset("human-white", kappa=0.0, **changes)


def test_names_begin_with_those_of_furcl(registered):
    assert samplers.names() == samplers.BUILT_IN
    registered("mine", EXAMPLE, needs_tables=True)
    assert samplers.names() == (*samplers.BUILT_IN, "mine")
    assert samplers.find("mine").header == EXAMPLE


@pytest.mark.parametrize("name", samplers.BUILT_IN)
def test_names_of_furcl_are_kept(name):
    with pytest.raises(SamplerError, match="choose another"):
        samplers.register(name, EXAMPLE, needs_tables=True)
    with pytest.raises(SamplerError, match="nothing to remove"):
        samplers.unregister(name)


def test_bad_registrations_are_refused(tmp_path):
    with pytest.raises(SamplerError, match="cannot be read"):
        samplers.register("mine", tmp_path / "absent.clh", needs_tables=False)
    with pytest.raises(SamplerError, match="allowed are 'uniform' and 'profile'"):
        samplers.register("mine", EXAMPLE, needs_tables=True, scattered_angles="even")  # pyright: ignore
    half = tmp_path / "half.clh"
    half.write_text("static inline void joint_densities() {}")
    with pytest.raises(SamplerError, match="does not define sample_lobe_and_offset"):
        samplers.register("mine", half, needs_tables=False)
    assert samplers.names() == samplers.BUILT_IN


def test_unknown_names_are_refused_in_scenes(scene_file):
    with pytest.raises(SceneError, match=r"render\.sampling = 'mine': allowed are uniform-h"):
        furcl.load_scene(scene_file, sampling="mine")


def test_a_copy_of_a_sampler_renders_the_same_picture(device, registered, scene_file):
    """The text decides, not the name."""
    registered("copy", _file("attenuation-cdf"), needs_tables=True)
    images = [
        furcl.render(furcl.load_scene(scene_file, sampling=name, spp=4, seed=3), device=device)
        for name in ("attenuation-cdf", "copy")
    ]
    assert np.array_equal(images[0].rgb, images[1].rgb)
    assert images[1].stats["sampling"] == "copy"


def test_an_error_names_the_samplers_own_file(device, registered, tmp_path):
    broken = tmp_path / "broken.clh"
    broken.write_text(EXAMPLE.read_text().replace("r.lobe = NO_LOBE;", "r.lobe = NO_SUCH;"))
    registered("broken", broken, needs_tables=True)
    with pytest.raises(KernelBuildError, match=r"broken\.clh"):
        Probe(fibre(), sampling="broken", device=device)


def test_includes_are_found_beside_the_file(device, registered, tmp_path):
    (tmp_path / "part.clh").write_text(EXAMPLE.read_text())
    (tmp_path / "whole.clh").write_text(
        '/* joint_densities and sample_lobe_and_offset */\n#include "part.clh"\n'
    )
    registered("whole", tmp_path / "whole.clh", needs_tables=True)
    assert Probe(fibre(), sampling="whole", device=device).sampler.name == "whole"


def test_a_sampler_without_tables_cannot_read_them(device, registered):
    """They are not declared, so that such a text does not compile."""
    registered("no-tables", _file("attenuation-cdf"), needs_tables=False)
    with pytest.raises(KernelBuildError, match="rows_at"):
        Probe(fibre(), sampling="no-tables", device=device)


def test_tables_are_needed_where_the_text_names_them(registered):
    assert registered("found", _file("attenuation-cdf")).needs_tables
    assert not registered("plain", _file("uniform-h")).needs_tables


def test_features_keep_their_sampler(registered):
    """Pickled or not, and after the name is gone or means another sampler."""
    kept = Features(sampler=registered("mine", EXAMPLE, needs_tables=True))
    registered("mine", _file("uniform-h"), needs_tables=False)
    assert pickle.loads(pickle.dumps(kept)) == kept
    assert kept.sampler is not None
    assert kept.sampler.header == EXAMPLE
    assert kept != Features(sampler=samplers.find("mine"))


@pytest.mark.statistical
@pytest.mark.parametrize("theta_deg", [0.0, 50.0])
def test_the_example_is_a_right_sampler(device, registered, seed, theta_deg):
    """Its weights are value over density, and their mean is that of the paper's sampler.

    Two-sample z test of 2^16 samples each, alpha 1e-4; with weights 2 % too large it must fail.
    """
    registered("lobe-cdf", EXAMPLE, needs_tables=True)
    theta = math.radians(theta_deg)
    wo = np.array([math.sin(theta), math.cos(theta), 0.0])
    means, errors = [], []
    for name in ("attenuation-cdf", "lobe-cdf"):
        probe = Probe(fibre(), sampling=name, device=device)
        wi, h, lobe, weight, pdf = probe.sample(wo, 1 << 16, seed)
        if name == "lobe-cdf":
            some = slice(0, 2000)
            for p in range(3):
                chosen = np.flatnonzero(lobe[some] == p)
                value = probe.evaluate(wo, wi[chosen], h[chosen], p)[:, 0]
                # Grazing directions lose digits on the way back to angles.
                kept = value > 1e-3 * value.max(initial=0.0)
                found = 0.5 * value[kept] / pdf[chosen][kept]
                assert np.allclose(weight[chosen][kept, 0], found, rtol=2e-2)
            assert np.abs(np.histogram(h, 2, (-1, 1))[0] / h.size - 0.5).max() < 0.01
        means.append(weight[:, 0].mean())
        errors.append(weight[:, 0].std() / math.sqrt(len(weight)))
    limit = 3.9 * math.hypot(*errors)
    assert abs(means[0] - means[1]) < limit
    assert abs(means[0] - 1.02 * means[1]) > limit


@pytest.mark.slow
def test_the_example_script_runs(device, scene_file, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("furcl.bench.convergence.open_device", lambda _: device)
    import compare_own_sampler

    compare_own_sampler.main(str(scene_file), str(tmp_path / "out"), "16x16", "2")
    samplers.unregister("lobe-cdf")
    assert "lobe-cdf efficiency" in capsys.readouterr().out
    assert (tmp_path / "out" / "index.html").exists()


def test_errors_are_furcls():
    with pytest.raises(FurclError):
        samplers.find("none")
    with pytest.raises(SceneError):
        decode_scene({"render": {"sampling": "none"}})
