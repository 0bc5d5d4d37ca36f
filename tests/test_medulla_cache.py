"""Medulla profiles on disk, and their dependence on seed and launch."""

from __future__ import annotations

import dataclasses
import logging
import threading
from pathlib import Path

import numpy as np
import pytest

from furcl.fibre.double_cylinder import profiles
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import build_profiles

FIBRE = Fibre(kappa=0.5, sigma_ms=1.0, g=0.2, sigma_ma=(0.1, 0.2, 0.3))


def build(device, fibre=FIBRE, **options):
    profiles = build_profiles(device, fibre, photons=64, **options)
    assert profiles is not None
    return profiles


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path))
    return tmp_path / "medulla"


@pytest.fixture
def simulations(monkeypatch) -> list:
    """Grows by one with every simulation."""
    calls = []

    def counted(*arguments):
        calls.append(arguments)
        return simulate(*arguments)

    simulate = profiles.simulate
    monkeypatch.setattr(profiles, "simulate", counted)
    return calls


def same(a, b) -> bool:
    return np.array_equal(a.pack(), b.pack()) and a.relative_error == b.relative_error


def test_second_build_reads_the_file(device, folder, simulations):
    assert same(build(device), build(device))
    assert len(simulations) == 1
    assert len(list(folder.iterdir())) == 1


@pytest.mark.parametrize(
    "changes", [{"sigma_ms": 1.01}, {"g": 0.21}, {"sigma_ma": 0.1}, {"eta": 1.5}, {"kappa": 0.51}]
)
def test_other_material_is_another_file(device, folder, changes):
    build(device)
    build(device, FIBRE.replace(**changes))
    assert len(list(folder.iterdir())) == 2


def test_parameters_of_no_medulla_share_the_file(device, folder, simulations):
    build(device)
    build(device, FIBRE.replace(beta_m_deg=20, sigma_ca=2.0, layers=1.0))
    assert len(simulations) == 1


def test_other_version_is_another_file(device, folder, simulations, monkeypatch):
    build(device)
    monkeypatch.setattr(profiles, "FORMAT_VERSION", profiles.FORMAT_VERSION + 1)
    build(device)
    assert len(simulations) == 2


@pytest.mark.parametrize(
    "damage", ["truncated", "garbage", "empty", "one byte", "other arrays", "not finite"]
)
def test_damaged_file_is_rebuilt(device, folder, simulations, damage, caplog):
    first = build(device)
    (path,) = folder.iterdir()
    content = path.read_bytes()
    if damage == "other arrays":
        profiles.store_cached(path, {"density": np.zeros(3)})
    elif damage == "not finite":
        arrays = profiles.load_cached(path, profiles._shapes(FIBRE))
        assert arrays is not None
        arrays["summary"][0] = np.nan
        profiles.store_cached(path, arrays)
    elif damage == "one byte":  # of the shape in an array's header, where zip reads no checksum
        at = content.index(b"(4, 32, 128)") + 2
        path.write_bytes(content[: at - 1] + b"2" + content[at:])
    else:
        path.write_bytes(
            {"truncated": content[: len(content) // 2], "garbage": b"x" * 999, "empty": b""}[damage]
        )
    with caplog.at_level(logging.WARNING):
        assert same(first, build(device))
    assert str(path) in caplog.text
    assert len(simulations) == 2
    assert same(first, build(device))
    assert len(simulations) == 2


def test_unwritable_folder_is_only_logged(device, tmp_path, monkeypatch, caplog):
    """A file stands where the folder should be: no user can write below it."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path / "file"))
    with caplog.at_level(logging.WARNING):
        build(device)
    assert "nothing is cached there" in caplog.text


def test_no_cache_leaves_no_file(device, folder):
    build(device, cache=False)
    assert not folder.exists()


def test_writers_at_once_leave_one_whole_file(tmp_path):
    """A reader never sees a part, and no temporary file stays."""
    path = tmp_path / "a.tables"
    shapes = {"a": (50_000,)}
    failures: list = []

    def write(value: int) -> None:
        for _ in range(20):
            profiles.store_cached(path, {"a": np.full(50_000, value)})
            arrays = profiles.load_cached(path, shapes)
            if arrays is None or (arrays["a"] != arrays["a"][0]).any():
                failures.append(value)

    writers = [threading.Thread(target=write, args=(i,)) for i in range(4)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert not failures
    assert list(tmp_path.iterdir()) == [path]


def test_result_is_a_function_of_the_seed(device):
    first = build(device, cache=False)
    assert same(first, build(device, cache=False))
    assert not same(first, build(device, cache=False, seed=2))


def test_result_does_not_depend_on_the_work_group_size(device):
    other = dataclasses.replace(device, is_cpu=not device.is_cpu)
    assert same(build(device, cache=False), build(other, cache=False))
