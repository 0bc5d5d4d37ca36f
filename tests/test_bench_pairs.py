"""Timing in turns, and intervals of medians."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from furcl.bench import pairs
from furcl.bench.pairs import in_turns, median_interval

RUNS = 4000


def test_actions_take_turns_forwards_and_backwards():
    calls: list[str] = []
    found = in_turns({name: lambda name=name: calls.append(name) for name in "abc"}, 3)
    assert "".join(calls) == "abccbaabc"
    assert list(found) == ["a", "b", "c"]
    assert all(took.wall.shape == took.cpu.shape == (3,) for took in found.values())


def test_waiting_takes_wall_seconds_and_working_takes_both(monkeypatch):
    """On clocks of its own: those of the process run on with the threads of other tests."""
    now = {"wall": 100.0, "cpu": 7.0}

    def spend(wall: float, cpu: float):
        now["wall"] += wall
        now["cpu"] += cpu

    clocks = SimpleNamespace(perf_counter=lambda: now["wall"], process_time=lambda: now["cpu"])
    monkeypatch.setattr(pairs, "time", clocks)
    found = in_turns({"wait": lambda: spend(0.5, 0.0), "work": lambda: spend(0.25, 0.75)}, 2)
    assert found["wait"].wall.tolist() == [0.5, 0.5]
    assert found["wait"].cpu.tolist() == [0.0, 0.0]
    assert found["work"].wall.tolist() == [0.25, 0.25]
    assert found["work"].cpu.tolist() == [0.75, 0.75]


def test_ends_are_values_of_the_sample():
    """For 6 values all; for 9 the second and the eighth leave out 2 (1 + 9) / 512 = 3.9 %."""
    six, nine = median_interval([5, 1, 2, 9, 3, 4]), median_interval([*range(1, 10)])
    assert (six.median, six.low, six.high, six.n) == (3.5, 1.0, 9.0, 6)
    assert (nine.median, nine.low, nine.high, nine.n) == (5.0, 2.0, 8.0, 9)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_few_values_allow_no_interval(n):
    found = median_interval(np.arange(n))
    assert (found.low, found.high) == (None, None)


def _share_that_holds_the_median(n, shrink, rng):
    """How often intervals of n skewed values hold the true median, `shrink` values narrower."""
    x = np.sort(np.exp(rng.standard_normal((RUNS, n))), axis=1)  # the true median is 1
    held = 0
    for row in x:
        found = median_interval(row)
        place = int(np.searchsorted(row, np.float64(found.low or np.nan))) + shrink
        held += row[place] <= 1.0 <= row[-1 - place]
    return held / RUNS


@pytest.mark.statistical
@pytest.mark.parametrize("n", [7, 12, 25])
def test_intervals_hold_the_median_as_often_as_they_say(n):
    """At least 95 % within 4 standard errors; one value narrower at each end they do not."""
    rng = np.random.default_rng(n)
    error = math.sqrt(0.95 * 0.05 / RUNS)
    assert _share_that_holds_the_median(n, 0, rng) > 0.95 - 4.0 * error
    assert _share_that_holds_the_median(n, 1, rng) < 0.95 - 4.0 * error
