"""Running sums of probabilities: what a search in them may find."""

import numpy as np
import pytest

from furcl.cdf import inclusive_cdf

ROWS = {
    "ordinary": [0.2, 0.5, 0.3],
    "one entry": [1.0],
    "nothing at the end": [0.25, 0.75, 0.0, 0.0],
    "nothing at the start": [0.0, 0.0, 1.0],
    "thirds": [1 / 3] * 3,
    "sum rounds above 1": [0.1] * 9 + [0.1 + 1e-7],
    "sum rounds below 1": [0.1] * 9 + [0.1 - 1e-7],
    "tiny after large": [1.0 - 1e-12, 1e-12],
}


@pytest.mark.parametrize("name", ROWS)
def test_a_search_finds_only_what_has_a_chance(name: str) -> None:
    """The first entry above u exists for the largest u below 1, and its chance is positive."""
    chance = np.array(ROWS[name])
    cdf = inclusive_cdf(chance)
    assert cdf.dtype == np.float32
    assert np.all(np.diff(cdf) >= 0)
    assert cdf == pytest.approx(np.cumsum(chance), abs=2e-7)
    for u in (np.float32(0.0), np.nextafter(np.float32(1.0), np.float32(0.0))):
        found = int(np.searchsorted(cdf, u, side="right"))
        assert found < len(chance)
        assert chance[found] > 0.0


def test_rows_are_summed_by_themselves() -> None:
    """Leading axes are rows; one that holds nothing ends at 1 all the same."""
    rows = np.array([[[0.5, 0.5, 0.0], [0.0, 0.0, 0.0]]])
    assert inclusive_cdf(rows).tolist() == [[[0.5, 1.0, 1.0], [0.0, 0.0, 1.0]]]


def test_sums_do_not_drift() -> None:
    """A million float32 entries, summed as float64; in float32 the error is 1e-3."""
    chance = np.full(1_000_000, 1e-6, np.float32)
    exact = np.arange(1, 1_000_001) * float(chance[0])
    assert np.abs(inclusive_cdf(chance) - exact).max() < 1e-6
    assert np.abs(np.cumsum(chance) - exact).max() > 1e-4
