"""The wheel holds all that rendering needs."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-index"]
    command += ["--no-build-isolation", "--wheel-dir", str(folder), str(REPOSITORY)]
    subprocess.run(command, check=True)
    (path,) = folder.glob("furcl-*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of a fresh environment: furcl from the wheel, the rest from this one."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    purelib = sysconfig.get_path("purelib", vars={"base": str(folder)})
    (Path(purelib) / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    subprocess.run([*command, "--no-deps", "--no-index", str(wheel)], check=True)
    return python


def output_of(python: Path, *command: str) -> str:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    return subprocess.run(
        [python.parent / command[0], *command[1:]],
        cwd=python.parent,
        env=environment,
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    ).stdout


@pytest.mark.parametrize("folder", ["kernels", "scenes"])
def test_wheel_holds_every_file(wheel: Path, folder: str) -> None:
    sources = {p.relative_to(REPOSITORY) for p in (REPOSITORY / folder).rglob("*.*")}
    assert sources
    names = zipfile.ZipFile(wheel).namelist()
    assert {f"furcl/{path}" for path in sources if (REPOSITORY / path).is_file()} <= set(names)


def test_wheel_holds_nothing_else(wheel: Path) -> None:
    roots = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert len(roots) == 2
    assert "furcl" in roots


def test_installed_wheel_finds_its_files(installed: Path) -> None:
    code = "from furcl.paths import *; print(kernel_folder(), scene_folder())"
    for folder in output_of(installed, "python", "-c", code).split():
        assert Path(folder).is_relative_to(installed.parents[1])


def test_installed_wheel_renders_a_pixel(installed: Path, tmp_path: Path) -> None:
    picture = tmp_path / "pixel.exr"
    command = ("furcl", "render", "single_fibre", "-o", str(picture), "--size", "1x1", "--spp", "1")
    output_of(installed, *command)
    assert picture.stat().st_size > 0


def _extras() -> dict[str, set[str]]:
    """Extra -> its packages; "" for what is always installed."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lists = {"": project["dependencies"], **project["optional-dependencies"]}
    return {
        extra: {re.split(r"[<>=]", package)[0] for package in packages}
        for extra, packages in lists.items()
    }


def test_every_extra_that_a_message_names_is_one() -> None:
    files = [p for name in ("furcl", "docs") for p in (REPOSITORY / name).rglob("*.*")]
    texts = [p.read_text(encoding="utf-8") for p in files if p.suffix in (".py", ".md")]
    named = {name for text in texts for name in re.findall(r"furcl\[(\w+)\]", text)}
    assert {"report", "cryptomatte"} <= named <= _extras().keys()


def test_the_page_of_dependencies_lists_the_packages_of_the_project() -> None:
    page = (REPOSITORY / "docs" / "dependencies.md").read_text(encoding="utf-8")
    base, extras = page.split("## ")[0].split("| extra |")
    rows = [
        ("", *re.findall(r"[\w-]+", line)[:1]) for line in base.splitlines() if line[:2] == "| "
    ]
    rows += re.findall(r"^\| (\w+) \| ([\w-]+) \|", extras, re.MULTILINE)
    of_page = {(extra, name) for extra, name in rows if name != "package"}
    assert of_page == {(extra, name) for extra, names in _extras().items() for name in names}
