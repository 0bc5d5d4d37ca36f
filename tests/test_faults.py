"""The short form of every case of bench/faults.sh."""

from __future__ import annotations

import subprocess

import pytest
from faults.__main__ import outcome, topics
from faults.case import Case, NotHereError
from faults.harness import environment

from furcl.paths import python_command

CASES = [
    pytest.param(case, id=f"{topic}: {case.name}")
    for topic, cases in topics().items()
    for case in cases
]


@pytest.mark.parametrize("case", CASES)
def test_faults(case, tmp_path):
    try:
        assert case.run(tmp_path, True)
    except NotHereError as error:
        pytest.skip(str(error))


def _wrong(folder, quick):
    raise AssertionError("it broke\nhere")


def _not_here(folder, quick):
    raise NotHereError("no such runtime")


def _broken(folder, quick):
    raise KeyError("x")


@pytest.mark.parametrize(
    ("run", "said", "right"),
    [
        (lambda folder, quick: f"{len(list(folder.iterdir()))} files", "0 files", True),
        (_wrong, "it broke", False),
        (_not_here, "no such runtime", None),
        (_broken, f"KeyError: 'x' (test_faults.py:{_broken.__code__.co_firstlineno + 1})", False),
    ],
)
def test_outcomes(run, said, right):
    assert outcome(Case("a case", run), True) == (said, right)


FORKS = """
import os, resource, signal, sys
from pathlib import Path
from faults import groom_seeds
from furcl.errors import GroomError
from furcl.groom.formats import load_curves

deaths = {1: lambda: os.kill(os.getpid(), signal.SIGABRT), 2: lambda: os._exit(3), 4: lambda: 1 / 0}
read = groom_seeds._within_seconds
def within_seconds(path, *rest):
    deaths.get(int(path.stem), int)()
    code = read(path, *rest)
    assert resource.getrlimit(resource.RLIMIT_CPU)[1] == 3600  # only root might raise it
    return code
groom_seeds._within_seconds = within_seconds
resource.setrlimit(resource.RLIMIT_CPU, (3600, 3600))

paths = [Path(sys.argv[1]) / f"{i}.usda" for i in range(6)]
for path in paths:
    path.write_bytes(groom_seeds.usda(path.parent))
with groom_seeds.usd_read_together(paths):
    for path in paths:
        try:
            print(load_curves(path).n_strands)
        except GroomError as error:
            print(error)
"""


def test_forks_that_die_while_they_read_usd(tmp_path):
    """Each costs the file that it was at, and the others are read."""
    pytest.importorskip("pxr", reason="usd-core is not installed")
    command = python_command("-c", FORKS, str(tmp_path))
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, check=True)
    read, *found = done.stdout.splitlines()
    assert int(read) > 0
    assert found == [
        "usd-core dies of signal 6",
        "usd-core ends the process",
        read,
        "usd-core ends the process",
        read,
    ]
