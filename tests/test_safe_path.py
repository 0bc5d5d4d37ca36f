"""Modules that lie in the working folder, such as that of a downloaded scene, are never run."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

import numpy as np
import pytest

import furcl
from furcl.bench import start
from furcl.errors import FurclError
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves, save_curves
from furcl.image.exr_decode import decode_apart
from furcl.image.image import Image
from furcl.install import doctor, provision


@pytest.fixture
def ran(tmp_path, monkeypatch):
    """A file that is written if one of the modules of the working folder is run."""
    folder, ran = tmp_path / "scene", tmp_path / "ran"
    folder.mkdir()
    for name in ("numpy", "json", "pyopencl", "OpenEXR", "pxr", "furcl", "sitecustomize"):
        code = f"open({str(ran)!r}, 'w').close()\nraise SystemExit(5)\n"
        (folder / f"{name}.py").write_text(code)
    monkeypatch.chdir(folder)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    return ran


def test_bench_start(ran, device, tmp_path):
    """Its renders, and what it imports; the variants that it compiles are in the slow tests."""
    with pytest.raises(FurclError, match="no-such-scene"):
        start.run(tmp_path / "no-such-scene.toml", tmp_path, device=device.name)
    assert (
        start._import_seconds(start._environment(tmp_path / "caches", tmp_path / "modules")) > 0.0
    )
    assert not ran.exists()


def test_pictures_and_grooms_that_other_processes_read(ran, tmp_path, rng):
    Image(rng.random((4, 6, 3)).astype(np.float32)).save(tmp_path / "a.exr")
    decode_apart(tmp_path / "a.exr", ["R"], (4, 6))
    if importlib.util.find_spec("pxr") is not None:
        curves = Curves.from_arrays(rng.random((6, 3)), 0.1, [0, 3, 6])
        save_curves(curves, tmp_path / "a.usda")
        assert load_curves(tmp_path / "a.usda").n_strands == 2
    assert not ran.exists()


def test_doctor_and_provision(ran, capfd):
    """They ask for the devices; what they find is not of interest."""
    list(doctor._check_devices())
    provision.devices_usable()
    assert not ran.exists()


def test_one_place_makes_commands_of_python():
    """All others have the safe path from it."""
    folder = Path(furcl.__file__).parent
    found = [
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr == "executable"
    ]
    assert found == ["paths.py"]
