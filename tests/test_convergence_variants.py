"""Variants of a scene: what is said, what is refused, and what becomes of them on a device."""

from __future__ import annotations

import csv
import json
import typing
from pathlib import Path

import msgspec
import pytest
from scene_documents import even_patch

from furcl.bench import convergence
from furcl.bench.convergence_plan import Plan
from furcl.bench.convergence_variants import CHOSEN, Variant, checks, chosen, settings_of
from furcl.errors import BenchError
from furcl.rendering.renderer import Renderer
from furcl.report.convergence import write_report
from furcl.scene.read import with_overrides
from furcl.scene.schema import choices
from furcl.scene.tables import Render

LIGHT = Variant.parse("light: light_sampling=auto roulette_depth=2")
BASE = Variant.parse("base: sampling=uniform-h light_sampling=bcsdf")


# What is said -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "name", "settings"),
    [
        ("base:", "base", ()),
        ("a: sampling=uniform-h", "a", ("render.sampling=uniform-h",)),
        (" + light (mis): max_depth=4  filter='box'", "+ light (mis)",
         ("render.max_depth=4", "film.filter=box")),
        ("x: render.residual=true film.filter_radius_px=2", "x",
         ("render.residual=true", "film.filter_radius_px=2")),
    ],
)  # fmt: skip
def test_variants_are_read(text, name, settings):
    found = Variant.parse(text)
    assert (found.name, found.settings) == (name, settings)
    render, film = found.scene(even_patch()).render, found.scene(even_patch()).film
    values = {**msgspec.to_builtins(render), **msgspec.to_builtins(film)}
    for setting in settings:
        key, _, value = setting.partition("=")
        assert str(values[key.partition(".")[2]]).lower().removesuffix(".0") == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sampling=uniform-h", "expected NAME: key=VALUE"),
        (": sampling=uniform-h", "expected NAME: key=VALUE"),
        ("a/b: sampling=uniform-h", "expected NAME: key=VALUE"),
        ("a|b: sampling=uniform-h", "expected NAME: key=VALUE"),
        ("a: sampling", "variant 'a': 'sampling': expected key=VALUE"),
        ("a: sampling=", "variant 'a': 'sampling=': expected key=VALUE"),
        ("a: sampling='uniform-h", "variant 'a': No closing quotation; close the quotes"),
        ("a: spp=4", "variant 'a': render.spp is not a variant's: --spp says"),
        ("a: seed=4", "render.seed is not a variant's: --seed is the one"),
        ("a: film.width=4", "film.width is not a variant's: --size is one"),
        ("a: residual=true render.residual=false", "render.residual is given twice; keep one"),
        ("a: camera.vfov_deg=4", "keys of .render. and .film. only; --set camera.vfov_deg=VALUE"),
    ],
)
def test_what_is_no_variant_is_refused(text, message):
    with pytest.raises(BenchError, match=message):
        Variant.parse(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: samplng=uniform-h", "variant 'a': scene 'patch': unknown key render.samplng; did"),
        ("a: samplng=uniform-h", "you mean render.sampling. Known are spp, seed"),
        ("a: fiter=box", "unknown key film.fiter; did you mean film.filter. Known are width"),
        ("a: nothing=1", "unknown key render.nothing. Known are spp"),
        ("a: sampling=uniform", "render.sampling = 'uniform': .*did you mean 'uniform-h'"),
        ("a: light_sampling=mix", "allowed are auto, bcsdf, mis; did you mean 'mis'"),
        ("a: roulette_depth=-1", "render.roulette_depth = -1: expected `int` >= 0"),
    ],
)  # fmt: skip
def test_scenes_refuse_settings_in_their_own_words(text, message):
    with pytest.raises(BenchError, match=message):
        Plan((even_patch(),), (Variant.parse(text),))


def test_plans_take_variants_and_the_short_form():
    plan = Plan((even_patch(),), (BASE, LIGHT), sampling=("full-cdf",), baseline="light")
    assert plan.names == ("base", "light", "full-cdf")
    assert plan.baseline == "light"
    assert Plan((even_patch(),), (LIGHT, BASE)).baseline == "light"
    assert Plan((even_patch(),)).names == ("uniform-h", "attenuation-cdf", "full-cdf")
    with pytest.raises(BenchError, match="no variant has that name; there are base, light"):
        Plan((even_patch(),), (BASE, LIGHT), baseline="dark")
    with pytest.raises(BenchError, match="one or more with different names"):
        Plan((even_patch(),), (BASE, BASE))


# What follows from settings ---------------------------------------------------------------------


def test_every_choice_of_auto_is_stated():
    hints = {field.name: field.type for field in msgspec.structs.fields(Render)}
    assert {key for key, hint in hints.items() if "auto" in choices(hint)} == set(CHOSEN)


@pytest.mark.parametrize(
    ("settings", "slope", "own_variance", "mean"),
    [
        ((), True, True, True),
        (("render.light_sampling=mis", "render.roulette_depth=0"), True, True, True),
        (("render.variance=false",), True, False, True),
        (("film.filter=box",), False, False, False),
        (("render.max_depth=2",), False, False, False),
        (("render.residual=true",), False, False, False),
    ],
)
def test_checks_that_hold(settings, slope, own_variance, mean):
    scene = even_patch()
    found = checks(scene, Variant("a", settings).scene(scene), {})
    holds = [found[name] is None for name in ("slope", "own_variance", "mean")]
    assert holds == [slope, own_variance, mean]


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({}, None),
        ({"sequence": "independent", "allocation": "even"}, None),
        ({"sequence": "sobol"}, "sequence = sobol"),
        ({"allocation": "adaptive"}, "allocation = adaptive"),
        ({"sequence": "sobol", "allocation": "adaptive"},
         "sequence = sobol, allocation = adaptive"),
    ],
)  # fmt: skip
def test_samples_that_depend_on_each_other_fail_the_checks_of_independent_ones(values, reason):
    """By what was found of a key, whether [render] has it or not."""
    scene = even_patch()
    found = checks(scene, scene, values)
    assert found == {"slope": reason, "own_variance": reason, "mean": None}


def test_settings_leave_out_what_is_the_plans():
    found = settings_of(LIGHT.scene(even_patch()))
    assert found["render"]["roulette_depth"] == 2
    assert not {"spp", "seed"} & set(found["render"])
    assert not {"width", "height"} & set(found["film"])


# On a device ------------------------------------------------------------------------------------


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path / "cache"))


class StopAfter:
    """A progress function that stops a run when a share of it is done."""

    def __init__(self, share: float) -> None:
        self.share = share

    def __call__(self, done: int, total: int) -> bool:
        return done > self.share * total


def plan(**changes: typing.Any) -> Plan:
    bare = Variant.parse("bare: variance=false statistics=false filter=box")
    values = {"variants": (LIGHT, BASE, bare), "baseline": "base", "spp": (2, 4), "runs": 3}
    return Plan((even_patch(),), **{**values, **changes})


def test_a_stopped_comparison_of_variants_goes_on(device, cache, tmp_path):
    folder = tmp_path / "out"
    stopped = convergence.run(plan(), folder, device=device, progress=StopAfter(0.85))
    kept = stopped["renders"]
    assert not stopped["complete"]
    assert 0 < len(kept) < 18
    results = convergence.run(plan(), folder, device=device)
    assert results["complete"]
    assert len(results["renders"]) == 18
    assert [row for row in results["renders"] if row in kept] == kept
    assert json.loads((folder / "results.json").read_text()) == results
    with (folder / "results.csv").open() as file:
        assert {row["variant"] for row in csv.DictReader(file)} == {"light", "base", "bare"}

    assert results["plan"]["baseline"] == "base"
    assert results["plan"]["variants"][0] == {
        "name": "light",
        "settings": ["render.light_sampling=auto", "render.roulette_depth=2"],
    }
    found = results["scenes"][0]
    assert found["reference"]["variant"] in ("light", "base")
    assert set(found["reference"]["pilot"]) == {"light", "base"}  # another filter, another picture
    light, base, bare = found["variants"]
    assert light["chosen"] == {"light_sampling": "bcsdf"}  # even light is not worth sampling
    assert base["chosen"] == {}
    assert light["settings"]["render"]["light_sampling"] == "auto"
    assert bare["compiled"] != base["compiled"]
    assert bare["checks"]["mean"] == "filter is not the scene's"
    assert bare["spp"][0]["variance"] is None is bare["spp"][0]["mse_over_variance"]
    assert base["spp"][0]["variance"] > 0.0
    assert [row["variant"] for row in found["comparisons"]] == ["light", "bare"]
    for row in found["comparisons"]:
        assert row["baseline"] == "base"
        assert row["efficiency_rays"]["n"] == 3

    page = write_report(folder)
    text = page.read_text()
    assert "light_sampling = bcsdf" in text
    assert "says nothing: filter is not the scene&#39;s" in text
    assert (folder / "plots" / "patch-rmse.png").stat().st_size > 10_000

    other = Variant.parse("light: light_sampling=auto roulette_depth=3")
    with pytest.raises(BenchError, match="holds renders of patch by light with another scene"):
        convergence.run(plan(variants=(other, BASE)), folder, device=device)


def test_auto_is_told_by_what_the_kernels_have(device):
    for kind, sampled in (("constant", "bcsdf"), ("sky", "mis")):
        scene = LIGHT.scene(with_overrides(even_patch(), [f"environment.kind={kind}"]))
        assert chosen(scene, Renderer(scene, device).features) == {"light_sampling": sampled}
