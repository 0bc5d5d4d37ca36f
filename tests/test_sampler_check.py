"""`furcl.samplers.check`: right samplers pass, and each fault of a sampler is named."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

import furcl
from furcl.cli.bench import app
from furcl.errors import SamplerError
from furcl.oracle.sampler_check import default_fibres

EXAMPLE = Path(__file__).parents[1] / "bench" / "samplers" / "lobe_cdf.clh"
DRAWN = "return sample_lobe_at(fibre, in, 2.0f * xi.z - 1.0f, xi.y);"
KEPT = f"LobeAndOffset r = {DRAWN.removeprefix('return ')}"
DENSITIES = "lobe_shares(fibre, b, joint);"
SCALED = f"{DENSITIES} for (uint p = 0; p < FURCL_LOBES; p++) joint[p] *= "
NAMES = {
    "mean": "mean weight over the albedo",
    "density": "samples whose density is not that of joint_densities",
    "counts": "counts of lobe and h",
    "light": "mean of light samples over the far field",
}
# What is replaced in the text of uniform-h, and the comparisons that must fail.
FAULTS = {
    "4 % of the light lost by a density": (
        {DRAWN: f"{KEPT} r.joint *= 1.04f; return r;"},
        {"mean", "density"},
    ),
    "4 % of the samples lost": (
        {DRAWN: f"{KEPT} if (xi.x < 0.04f) r.lobe = NO_LOBE; return r;"},
        {"mean", "counts"},
    ),
    "densities that both functions report 4 % too large": (
        {
            DRAWN: f"{KEPT} r.joint *= 1.04f; return r;",
            DENSITIES: SCALED + "1.04f;",
        },
        {"mean", "counts"},
    ),
    "densities of light samples 4 % too small": ({DENSITIES: SCALED + "0.96f;"}, {"light"}),
    "one side of the fibre alone": (
        {DRAWN: "return sample_lobe_at(fibre, in, xi.z, xi.y);"},
        {"counts"},
    ),
    "h nearer to the middle": (
        {DRAWN: "return sample_lobe_at(fibre, in, 1.96f * xi.z - 0.98f, xi.y);"},
        {"counts"},
    ),
    "a lobe never drawn": (
        {
            DRAWN: f"{KEPT} if (r.lobe == 2u) r.lobe = NO_LOBE; return r;",
            DENSITIES: f"{DENSITIES} joint[2] = 0.0f;",
        },
        {"mean"},
    ),
}  # fmt: skip


@pytest.fixture
def faulty(tmp_path):
    """Registers uniform-h with parts of its text replaced, for the length of a test."""

    def register(changes: dict[str, str]) -> str:
        text = furcl.samplers.find("uniform-h").text()
        for old, new in changes.items():
            assert text.count(old) == 1
            text = text.replace(old, new)
        (tmp_path / "faulty.clh").write_text(text)
        return furcl.samplers.register("faulty", tmp_path / "faulty.clh").name

    yield register
    furcl.samplers.unregister("faulty")


@pytest.mark.statistical
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named(device, faulty, seed, fault):
    """By the comparisons that it breaks, of one fibre and inclination; alpha 1e-3 for all."""
    changes, broken = FAULTS[fault]
    of = "yan2015" if "light" in broken else "human-white"
    fibres = {of: default_fibres()[of]}
    found = furcl.samplers.check(
        faulty(changes), fibres=fibres, thetas_deg=(50.0,), device=device, seed=seed
    )
    assert not found.unbiased
    assert {NAMES[name] for name in broken} <= {finding.test for finding in found.wrong}
    assert str(found).startswith("faulty: biased: ")
    assert all(finding.test in str(found) for finding in found.wrong)


@pytest.mark.statistical
def test_a_right_sampler_passes(device, faulty, seed):
    """The text of uniform-h, of one fibre; alpha 1e-3 for all comparisons."""
    fibres = {"human-white": default_fibres()["human-white"]}
    found = furcl.samplers.check(faulty({}), fibres=fibres, device=device, seed=seed)
    assert found.unbiased, found
    assert len(found.findings) == 24
    assert "chance of 0.999" in str(found)


@pytest.mark.slow
@pytest.mark.statistical
@pytest.mark.parametrize("name", ["uniform-h", "full-cdf", "lobe_cdf"])
def test_right_samplers_pass_for_all_fibres(device, seed, name):
    """furcl's own, and the example of docs/own_sampler.md; alpha 1e-3 each."""
    if name == "lobe_cdf":
        furcl.samplers.register(name, EXAMPLE)
    found = furcl.samplers.check(name, device=device, seed=seed)
    assert found.unbiased, found
    if name == "lobe_cdf":
        furcl.samplers.unregister(name)


@pytest.mark.parametrize(("factor", "code"), [("1.0", 0), ("1.04", 1)])
def test_the_command_ends_by_what_it_found(tmp_path, monkeypatch, device, factor, code):
    """Few samples, in which 4 % still show: the density of each sample is another."""
    fibres = {"human-white": default_fibres()["human-white"]}
    monkeypatch.setattr("furcl.oracle.sampler_check.default_fibres", lambda: fibres)
    text = furcl.samplers.find("uniform-h").text()
    wrong = f"{KEPT} r.joint *= {factor}f; return r;"
    (tmp_path / "mine.clh").write_text(text.replace(DRAWN, wrong))
    options = ["--samples", "1024", "--device", device.name]
    result = CliRunner().invoke(app, ["sampler", str(tmp_path / "mine.clh"), *options])
    furcl.samplers.unregister("mine")
    assert result.exit_code == code, result.output
    assert result.output.startswith("mine: biased" if code else "mine: nothing is wrong")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "none"}, "allowed are uniform-h"),
        ({"alpha": 0.0}, "alpha = 0.0"),
        ({"samples": 10}, "samples = 10"),
        ({"fibres": {}}, "0 fibres"),
        ({"thetas_deg": (91.0,)}, "-90 to 90"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(SamplerError, match=message):
        furcl.samplers.check(**{"name": "uniform-h", **arguments})
