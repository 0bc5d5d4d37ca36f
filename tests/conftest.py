"""Fixtures that every test file may use: devices, random numbers and the optional data folder."""

from __future__ import annotations

import functools
import math
import re
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

from furcl.device.choice import Candidate, Device, list_candidates, open_candidate

REPOSITORY = Path(__file__).parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options of the suite."""
    group = parser.getgroup("furcl")
    group.addoption("--device", default="", help="only devices whose description contains this")
    group.addoption("--seed", type=int, default=0, help="0 (default): the committed seeds")
    group.addoption(
        "--time-limit", type=float, default=math.inf, help="skip what has not begun by then [s]"
    )


_BEGUN = time.monotonic()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test that would begin after the time limit."""
    limit = float(str(item.config.getoption("--time-limit")))
    if time.monotonic() - _BEGUN > limit:
        pytest.skip(f"the time limit of {limit:.0f} s is over")


@functools.cache
def _usable_candidates() -> tuple[Candidate, ...]:
    """Every device that passes the self-test, each driver's device once."""
    found = {c.description: c for c in list_candidates() if c.verdict().passed}
    return tuple(found.values())


def _short_name(candidate: Candidate) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", f"{candidate.runtime} {candidate.driver_version}".lower())


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run each test that asks for `device` on every usable OpenCL device."""
    if "device" not in metafunc.fixturenames:
        return
    wanted = str(metafunc.config.getoption("--device")).lower()
    candidates = [c for c in _usable_candidates() if wanted in c.description.lower()]
    names = [_short_name(c) for c in candidates]
    metafunc.parametrize(
        "device", candidates or [None], ids=names or ["none"], indirect=True, scope="session"
    )


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest) -> Device:
    """An opened OpenCL device; the test runs once for each usable one.

    No device is a failure, not a skip: a suite that computes nothing must not pass.
    """
    if request.param is None:
        pytest.fail("no usable OpenCL device: `furcl doctor` says why and what mends it")
    return _opened(request.param)


@functools.cache
def _opened(candidate: Candidate) -> Device:
    return open_candidate(candidate)


@pytest.fixture
def seed(request: pytest.FixtureRequest) -> int:
    """A seed that is a function of the test's name: the same in every run.

    `--seed N` changes all of them at once; statistical tests are then expected to fail at the
    rate that their alpha states.
    """
    name = f"{request.node.nodeid.split('[')[0]} {request.config.getoption('--seed')}"
    return zlib.crc32(name.encode())


@pytest.fixture
def rng(seed: int) -> np.random.Generator:
    """A numpy generator seeded by `seed`."""
    return np.random.default_rng(seed)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real grooms and lights, which the repository does not hold."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"the optional data folder {folder} is absent")
    return folder
