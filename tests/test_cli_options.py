"""Options that commands share, and samplers that are given as files."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_lines import run

from furcl.bench.convergence_plan import SAMPLING
from furcl.bench.intersect import groom_and_camera
from furcl.cli import command, main
from furcl.fibre import samplers
from furcl.image.image import Image

EXAMPLE = Path(__file__).parents[1] / "bench" / "samplers" / "lobe_cdf.clh"

# Options that mean something else by command: picture or folder; one value or device, or a list; a
# value of a scene or of its fibre.
OF_SEVERAL_MEANINGS = {
    "--output", "--device", "--spp", "--sampling", "--size", "--runs", "--set",
    "--samples",
}  # fmt: skip


def commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """All commands of a group with their names, and the groups inside it."""
    for name, inner in group.commands.items():
        yield (*path, name), inner
        if hasattr(inner, "commands"):
            yield from commands(inner, (*path, name))


@pytest.mark.parametrize(
    ("words", "level"),
    [
        (["convert", "none.npz", "x.npz"], logging.INFO),
        (["-q", "convert", "none.npz", "x.npz"], logging.WARNING),
        (["convert", "-q", "none.npz", "x.npz"], logging.WARNING),
        (["convert", "none.npz", "x.npz", "--quiet"], logging.WARNING),
        (["--verbose", "convert", "none.npz", "x.npz"], logging.DEBUG),
        (["convert", "none.npz", "-v", "x.npz"], logging.DEBUG),
        (["-v", "bench", "replay", "{}"], logging.DEBUG),
        (["bench", "-v", "replay", "{}"], logging.DEBUG),
        (["bench", "replay", "{}", "-v"], logging.DEBUG),
        (["-v", "convert", "none.npz", "x.npz", "-q"], logging.WARNING),
    ],
)
def test_quiet_and_verbose_stand_anywhere(
    words: list[str], level: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("furcl.bench.stability.replay", lambda *_: [])
    run(*words)
    assert logging.getLogger("furcl").level == level


def test_every_command_takes_them() -> None:
    found = list(commands(command()))
    assert ("bench", "convergence") in dict(found)
    for path, inner in found:
        flags = {flag for option in inner.params for flag in option.opts}
        assert {"-v", "--verbose", "-q", "--quiet"} <= flags, path


def test_an_option_is_declared_once() -> None:
    """The same name has the same words in every command that takes it."""
    texts: dict[str, set[str]] = defaultdict(set)
    for _, inner in commands(command()):
        for option in inner.params:
            for flag in {flag for flag in option.opts if flag.startswith("--")}:
                texts[flag].add(option.help or "")
    assert texts["--device"]
    assert {flag for flag, found in texts.items() if len(found) > 1} <= OF_SEVERAL_MEANINGS
    assert all("" not in found for found in texts.values())


class GivenError(Exception):
    """Carries what a command handed on."""

    def __init__(self, value: Any) -> None:
        self.value = value


@pytest.fixture
def own_samplers() -> Iterator[None]:
    """Samplers that a test registers are forgotten after it."""
    yield
    for name in set(samplers.names()) - set(samplers.BUILT_IN):
        samplers.unregister(name)


@pytest.mark.parametrize("stem", ["lobe", "nan", "1e3", "true", "1979-01-01", "a.b"])
def test_a_sampler_of_a_file_renders(
    stem: str, own_samplers: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def render(scene: Any, **_: Any) -> Image:
        return Image(np.zeros((1, 1, 3), np.float32), None, {"sampling": scene.render.sampling})

    monkeypatch.setattr("furcl.rendering.renderer.render", render)
    file = tmp_path / f"{stem}.clh"
    file.write_text(EXAMPLE.read_text())
    picture = tmp_path / "a.exr"
    assert run("render", "single_fibre", "-o", picture, "--sampler", file) == 0
    assert Image.load(picture).stats["sampling"] == stem
    assert samplers.find(stem).header == file


@pytest.mark.parametrize("named", [None, "uniform-h,full-cdf"])
def test_samplers_of_files_are_compared(
    named: str | None, own_samplers: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def bench(plan: Any, *_: Any, **__: Any) -> None:
        raise GivenError(plan)

    monkeypatch.setattr("furcl.bench.convergence.run", bench)
    words = ["bench", "convergence", "single_fibre", "-o", str(tmp_path), "--quick"]
    words += ["--sampling", named] if named else []
    for stem in ("one", "two"):
        (tmp_path / f"{stem}.clh").write_text(EXAMPLE.read_text())
        words += ["--sampler", str(tmp_path / f"{stem}.clh")]
    with pytest.raises(GivenError) as given:
        main(words)
    others = tuple(named.split(",")) if named else SAMPLING
    assert given.value.value.sampling == (*others, "one", "two")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--sampler", "none.clh"], "none.clh cannot be read"),
        (["--sampler", "half.clh"], "does not define sample_lobe_and_offset"),
        (["--sampler", "full-cdf.clh"], "the name must not be"),
        (["--sampler", "good.clh", "--sampling", "full-cdf"], "keep one"),
    ],
)
def test_sampler_files_that_are_refused(
    options: list[str], message: str, own_samplers: None, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("half.clh").write_text("void joint_densities() {}")
    for name in ("good.clh", "full-cdf.clh"):
        Path(name).write_text(EXAMPLE.read_text())
    assert run("render", "single_fibre", "-o", "a.exr", *options) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("name", ["stages", "features", "start", "intersect"])
def test_benchmarks_take_the_names_of_scenes(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are handed on as they are: `furcl.load_scene` finds them."""

    def hand_on(*given: Any, **_: Any) -> None:
        raise GivenError(given[0])

    monkeypatch.setattr(f"furcl.bench.{name}.run", hand_on)
    with pytest.raises(GivenError) as given:
        main(["bench", name, "single_fibre", "-o", str(tmp_path)])
    assert given.value.value in ("single_fibre", ["single_fibre"])


def test_the_ray_benchmark_finds_scenes_by_name() -> None:
    curves, _ = groom_and_camera("single_fibre")
    assert curves.n_strands == 1
