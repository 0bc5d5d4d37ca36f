"""The command line: arguments, errors as one message, Ctrl-C that keeps the picture."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_lines import run

from furcl import cli
from furcl.cli import main
from furcl.device.choice import Device
from furcl.errors import GroomError, NoDeviceError
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves, save_curves
from furcl.image.image import Image
from furcl.paths import scene_folder
from furcl.rendering import renderer
from furcl.settings import switched_on

FIBRE_SCENE = """
[fibre]
preset = "human-black"
[environment]
kind = "constant"
radiance = [1.0, 1.0, 1.0]
[curves]
file = "groom.npz"
"""


@pytest.fixture
def groom(tmp_path: Path) -> Path:
    points = np.array([[0, 0, 0], [0, 0, 1], [0, 0.5, 2], [1, 0, 0], [1, 0, 1]], np.float32)
    path = tmp_path / "groom.npz"
    save_curves(Curves.from_arrays(points, 0.05, [0, 3, 5]), path)
    return path


@pytest.fixture
def scene(groom: Path) -> Path:
    path = groom.with_name("scene.toml")
    path.write_text(FIBRE_SCENE)
    return path


class FakeRender:
    """Stands in for furcl.render: keeps what it was given, reports half of the work."""

    def __init__(self, interrupt: bool = False) -> None:
        self.interrupt = interrupt
        self.given: dict[str, Any] = {}

    def __call__(self, scene: Any, **keywords: Any) -> Image:
        self.given = {"scene": scene, **keywords}
        if self.interrupt:
            os.kill(os.getpid(), signal.SIGINT)
            for _ in range(500):  # another thread receives it
                if keywords["progress"](50, 100):
                    break
                time.sleep(0.01)
        self.stopped = keywords["progress"](50, 100)
        rgb = np.full((2, 3, 3), 0.25, np.float32)
        return Image(rgb, np.zeros_like(rgb), {"spp": 4, "seed": 1})


@pytest.fixture
def fake_render(monkeypatch: pytest.MonkeyPatch) -> FakeRender:
    fake = FakeRender()
    monkeypatch.setattr(renderer, "render", fake)
    return fake


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    text = capsys.readouterr().out
    for command in ("render", "info", "convert", "compare", "devices", "doctor"):
        assert f"  {command} " in text


def test_start_loads_nothing_heavy() -> None:
    heavy = ("numpy", "numba", "scipy", "pyopencl", "matplotlib", "OpenEXR", "embreex")
    code = f"import sys, furcl, furcl.cli; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(("given", "expected"), [(None, "1"), ("3", "3")])
def test_commands_keep_numpys_blas_to_one_thread(
    monkeypatch: pytest.MonkeyPatch, given: str | None, expected: str
) -> None:
    """Unless the user asks for more; its threads would wait in a loop beside the render."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if given:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", given)
    assert run("--help") == 0
    assert os.environ["OPENBLAS_NUM_THREADS"] == expected


def test_render_passes_options(scene: Path, fake_render: FakeRender, tmp_path: Path) -> None:
    out, stats = tmp_path / "new" / "out.exr", tmp_path / "stats.json"
    options = ["--spp", 5, "--seed", 7, "--size", "6x4", "--sampling", "uniform-h"]
    options += ["--max-depth", 9, "--device", "some", "--time-limit", 2.5, "--stats", stats]
    options += ["--set", "curves.radius_scale=2", "--target-rmse", 0.5]
    assert run("render", scene, "-o", out, *options) == 0
    given = fake_render.given
    render, film = given["scene"].render, given["scene"].film
    assert (render.spp, render.seed, render.sampling, render.max_depth) == (5, 7, "uniform-h", 9)
    assert (film.width, film.height, given["scene"].curves.radius_scale) == (6, 4, 2)
    assert (given["device"], given["time_limit"]) == ("some", 2.5)
    assert (given["spp"], given["target_rmse"], given["target_relmse"]) == (5, 0.5, None)
    assert not fake_render.stopped
    assert Image.load(out).rgb.shape == (2, 3, 3)
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert json.loads(stats.read_text()) == {"spp": 4, "seed": 1}


def test_interrupt_writes_what_there_is(
    scene: Path, fake_render: FakeRender, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    fake_render.interrupt = True
    # Shells start background commands with SIGINT ignored, and what is ignored stays so.
    ignored = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, ignored))
    before = signal.getsignal(signal.SIGINT)
    assert run("render", scene, "-o", tmp_path / "out.exr") == 130
    assert fake_render.stopped
    assert (tmp_path / "out.exr").exists()
    assert signal.getsignal(signal.SIGINT) is before


def test_progress_lines(
    scene: Path, fake_render: FakeRender, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr("furcl.progress.LOG_INTERVAL_S", 0.0)
    assert run("render", scene, "-o", tmp_path / "out.exr") == 0
    lines = capsys.readouterr().err
    assert " 50 %" in lines
    assert "stopped early: 4 of 64 samples a pixel" in lines
    assert run("--quiet", "render", scene, "-o", tmp_path / "out.exr", "--spp", 4) == 0
    assert capsys.readouterr().err == ""


def test_names_of_shipped_scenes(fake_render: FakeRender, tmp_path: Path) -> None:
    names = [path.stem for path in scene_folder().glob("*.toml")]
    assert "single_fibre" in names
    assert run("render", "single_fibre", "-o", tmp_path / "out.exr", "--spp", 1) == 0
    assert fake_render.given["scene"].name == "single_fibre"


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["info", "none.npz"], 2, "none.npz"),
        (["info", "none.toml"], 2, "there is no such scene file"),
        (["convert", "none.hair", "x.npz"], 2, "none.hair"),
        (["compare", "none.exr", "none.exr"], 2, "none.exr"),
        (["render", "none.toml", "-o", "x.exr"], 2, "none.toml"),
        (["render", "none.toml", "-o", "x.jpg"], 2, ".exr or .png"),
        (["render", "none.toml"], 2, "--output"),
        (["unknown"], 2, "unknown"),
    ],
)
def test_bad_input_is_one_message(
    arguments: list[str],
    code: int,
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == code
    message = capsys.readouterr().err
    assert words in message
    assert "Traceback" not in message


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("FURCL_TRACEBACK", "1", True),
        ("FURCL_TRACEBACK", "0", False),
        ("FURCL_TRACEBACK", "", False),
        ("FURCL_DEBUG", "1", False),
    ],
)
def test_tracebacks_have_a_switch_of_their_own(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, shown: bool
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(GroomError if shown else SystemExit):
        main(["info", "none.npz"])
    assert switched_on(name) == (value == "1")


def test_no_device_ends_with_three(
    scene: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def no_device(*_: Any, **__: Any) -> Image:
        raise NoDeviceError("no OpenCL device: none")

    monkeypatch.setattr(renderer, "render", no_device)
    assert run("render", scene, "-o", scene.with_name("out.exr")) == 3
    assert capsys.readouterr().err == "furcl: no OpenCL device: none\n"


def test_devices_without_any_runtime(tmp_path: Path) -> None:
    """A loader that is sent to a missing folder finds nothing at all."""
    environment = {**os.environ, "OCL_ICD_VENDORS": str(tmp_path / "missing")}
    command = [sys.executable, "-c", "from furcl.cli import main; main(['devices'])"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 3
    assert done.stdout == ""
    assert done.stderr.startswith("furcl: no OpenCL device: ")
    assert done.stderr.count("\n") == 1
    assert "furcl doctor" in done.stderr


def test_devices(device: Device, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("devices") == 0
    text = capsys.readouterr().out
    assert device.driver_version in text
    assert "passes the self-test" in text
    assert "furcl uses device " in text


def test_convert_and_info(groom: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = groom.with_suffix(".hair")
    assert run("convert", groom, target) == 0
    assert np.array_equal(load_curves(target).points, load_curves(groom).points)
    assert run("info", target) == 0
    text = capsys.readouterr().out
    assert "strands              2\n" in text
    assert "points               5 (2 to 3 a strand)\n" in text


def test_info_of_a_scene(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", scene, "--set", "render.spp=3") == 0
    text = capsys.readouterr().out
    assert "3 spp" in text
    assert "segments             3\n" in text


def test_compare(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("flip_evaluator")
    rgb = np.full((4, 4, 3), 0.5, np.float32)
    for name, shift in (("a", 0.25), ("b", 0.0)):
        Image(rgb + np.float32(shift), None, {}).save(tmp_path / f"{name}.exr")
    assert run("compare", tmp_path / "a.exr", tmp_path / "b.exr") == 0
    assert "rmse       0.25\n" in capsys.readouterr().out


def test_missing_extra_is_named(
    scene: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    image = scene.with_name("a.exr")
    Image(np.zeros((2, 2, 3), np.float32), None, {}).save(image)
    assert run("compare", image, image) == 2
    assert "furcl[report]" in capsys.readouterr().err


def test_a_missing_package_is_not_called_an_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken() -> None:
        raise ModuleNotFoundError("No module named 'pydantic'", name="pydantic")

    monkeypatch.setattr(cli, "command", broken)
    assert run("devices") == 2
    said = capsys.readouterr().err
    assert "pydantic" in said
    assert "--force-reinstall furcl" in said
    assert "[report]" not in said


def test_the_extra_holds_the_modules_that_messages_say_it_holds() -> None:
    wanted = [line for line in importlib.metadata.requires("furcl") or [] if "'report'" in line]
    names = {re.split(r"[^\w-]", line, maxsplit=1)[0].replace("-", "_") for line in wanted}
    assert names == set(cli.REPORT_MODULES)


def test_a_turntable_is_written_frame_by_frame(scene, tmp_path):
    arguments = ["render", scene, "--size", "8x6", "--spp", "1", "--frames", "8:11"]
    arguments += ["--orbit", "360", "-o", tmp_path / "turn.###.exr"]
    assert run(*arguments, "--stats", tmp_path / "#.json") == 0
    for frame in ("008", "009", "010"):
        assert Image.load(tmp_path / f"turn.{frame}.exr").stats["frame"] == int(frame)
        assert (tmp_path / f"turn.{frame}.png").exists()
    assert json.loads((tmp_path / "10.json").read_text())["frame"] == 10


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--frames", "0:3", "-o", "a.#.exr"], "give both"),
        (["--orbit", "90", "-o", "a.#.exr"], "give both"),
        (["--frames", "0:3", "--orbit", "90", "-o", "a.exr"], "must hold #"),
        (["--frames", "0:3", "--orbit", "9", "-o", "#.exr", "--stats", "s"], "must hold #"),
        (["-o", "a.#.exr"], "must not hold #"),
        (["--frames", "3:0", "--orbit", "90", "-o", "a.#.exr"], "expected FIRST:END"),
    ],
)
def test_options_of_a_turntable_that_do_not_go_together(
    scene, tmp_path, monkeypatch, capsys, options, words
):
    monkeypatch.chdir(tmp_path)
    assert run("render", scene, *options) == 2
    assert words in " ".join(re.sub("[│╭╮╰╯─]", " ", capsys.readouterr().err).split())
    assert not list(tmp_path.glob("*.exr"))
