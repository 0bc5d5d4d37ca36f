"""What goes out is checked before the work, and written whole after it."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from command_lines import run

from furcl.errors import BenchError, GroomError, ImageError
from furcl.files import atomic_path, check_writable
from furcl.image.image import Image

SCENE = """
[fibre]
preset = "human-black"
kappa = 0.0
[environment]
kind = "image"
file = "light.exr"
[curves]
generator = "fibre"
[film]
width = 8
height = 8
[render]
spp = 1
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a scene, its light, a link, a pipe, a file and a folder."""
    (tmp_path / "scene.toml").write_text(SCENE)
    Image(light()).save(tmp_path / "light.exr")
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "file").touch()
    os.mkfifo(tmp_path / "pipe.exr")
    (tmp_path / "link.exr").symlink_to("target.exr")
    (tmp_path / "light-link.exr").symlink_to("light.exr")
    return tmp_path


def light():
    import numpy as np

    return np.ones((4, 8, 3), np.float32)


def _content(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file() and not p.is_symlink()}


@pytest.mark.parametrize(
    ("output", "more", "said"),
    [
        ("folder.exr", [], "is a folder"),
        ("pipe.exr", [], "is no regular file"),
        ("file/a.exr", [], "cannot be written"),
        ("a" * 250 + ".exr", [], "the name is too long"),
        ("a" * 300 + ".exr", [], "the name is too long"),
        ("a\udcff\ud800.exr", [], "surrogates not allowed"),
        ("a.exr", ["--stats", "folder.exr"], "is a folder"),
        ("a.exr", ["--stats", "pipe.exr"], "is no regular file"),
        ("a.exr", ["--stats", "a.exr"], "is also the name of the picture"),
        ("a.exr", ["--stats", "a.png"], "is also the name of the picture"),
        ("a.exr", ["--stats", "a.checkpoint"], "is also the name of the picture"),
        ("a.exr", ["--stats", "./file/../a.exr"], "cannot be written"),
        ("target.exr", ["--stats", "link.exr"], "is also the name of the picture"),
        ("a.exr", ["--stats", "scene.toml"], "is a file that the render reads"),
        ("light.exr", [], "is a file that the render reads"),
        ("light-link.exr", [], "is a file that the render reads"),
        ("a.exr", ["--time-limit", "nan"], "expected seconds, 0 or more"),
        ("a.exr", ["--time-limit", "-1"], "expected seconds, 0 or more"),
        ("a.exr", ["--checkpoint", "nan"], "expected a number above 0"),
        ("a.exr", ["--checkpoint", "0"], "expected a number above 0"),
        ("a.exr", ["--resume", "file"], "does not start as a checkpoint"),
    ],
)
def test_refused_before_the_render(output, more, said, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    before = _content(folder)
    assert run("render", "scene.toml", "-o", output, *more) == 2
    assert said in capsys.readouterr().err
    assert _content(folder) == before


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_what_is_read_only_is_refused(kind, folder, monkeypatch):
    """Root may write anything: what the system says is replaced."""
    path = folder / "old.exr"
    path.touch()
    monkeypatch.setattr(
        os, "access", lambda name, mode: Path(name) != (path if kind == "file" else folder)
    )
    if kind == "folder":
        monkeypatch.setattr(Path, "touch", _read_only)
    with pytest.raises(ImageError, match=r"read-only|Read-only"):
        check_writable(path, ImageError)


def _read_only(self, **_):
    raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(self))


@pytest.mark.parametrize("name", ["missing/folders/of/a.exr", "ü e\u0301 $x|y.exr", "link.exr"])
def test_names_that_are_fine(name, folder, monkeypatch, device):
    monkeypatch.chdir(folder)
    assert run("render", "scene.toml", "-o", name, "--stats", "s.json") == 0
    assert Image.load(name).stats["spp"] == 1
    assert (folder / "link.exr").is_symlink()
    assert (folder / "target.exr").exists() == (name == "link.exr")
    assert not list(folder.rglob(".furcl-*"))


def test_an_older_picture_stays_until_all_pixels_have_samples(folder, monkeypatch, device, capsys):
    monkeypatch.chdir(folder)
    assert run("render", "scene.toml", "-o", "a.exr") == 0
    old = _content(folder)
    command = ["render", "scene.toml", "-o", "a.exr", "--wave-size", 5, "--time-limit"]
    assert run(*command, "1e-9", "--set", "film.exposure_stops=2") == 0
    assert {name: _content(folder)[name] for name in old} == old
    assert set(_content(folder)) - set(old) == {"a.partial.exr", "a.partial.png"}
    said = capsys.readouterr().err
    assert "a.exr is left as it was" in said
    part = Image.load("a.partial.exr")
    assert part.samples is not None
    assert (part.samples == 0).any()
    assert part.exposure_stops == 2.0
    assert not part.rgb[part.samples == 0].any()


@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("convergence", ["single_fibre"]),
        ("stability", []),
        ("stages", ["single_fibre"]),
        ("waves", ["single_fibre"]),
        ("features", ["single_fibre"]),
        ("start", ["single_fibre"]),
        ("intersect", ["hair:100"]),
    ],
)
@pytest.mark.parametrize(("name", "said"), [("file", "exists"), ("a" * 300, "too long")])
def test_folders_of_benchmarks(command, options, name, said, folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    assert run("bench", command, *options, "-o", name) == 2
    assert said in capsys.readouterr().err


# Files that appear whole ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "error",
    [
        lambda path: GroomError(f"{path}: cannot be written: full; check folder and space"),
        lambda path: OSError(errno.ENOSPC, "No space left on device", str(path)),
    ],
)
def test_errors_name_the_file_and_not_the_hidden_one(error, tmp_path):
    path = tmp_path / "a.npz"
    path.write_bytes(b"old")

    def fail():
        with atomic_path(path) as temporary:
            temporary.write_bytes(b"half")
            raise error(temporary)

    with pytest.raises((GroomError, OSError)) as caught:
        fail()
    assert str(path) in str(caught.value)
    assert ".furcl-" not in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["a.npz"]
    assert path.read_bytes() == b"old"


def test_other_files_keep_their_names_in_errors(tmp_path):
    with pytest.raises(OSError, match=r"other\.npz"), atomic_path(tmp_path / "a.npz"):
        (tmp_path / "other.npz").read_bytes()


def test_the_folder_of_a_benchmark_is_refused_by_its_own_error(tmp_path):
    with pytest.raises(BenchError):
        check_writable(tmp_path, BenchError)
