"""The short form of every case of bench/faults.sh."""

from __future__ import annotations

import pytest
from faults.__main__ import outcome, topics
from faults.case import Case, NotHereError

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
