"""Which variants of a convergence run are marked as of another picture."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from furcl.bench.convergence_statistics import mean_interval
from furcl.report.convergence_checks import ALPHA, departures
from furcl.report.convergence_plots import save

RUNS, SPP, VARIANTS = 5, (16, 32, 64), ("a", "b", "c")


def results(rng, bias=None, spread=0.01, of_reference=0.0, checks=None):
    """Of three variants whose measures are normal around 1; the means of one are off by `bias`."""

    def estimate(mean):
        found = mean_interval(mean + spread * rng.normal(size=RUNS))
        return {"mean": found.mean, "low": found.low, "high": found.high}

    shift = of_reference * rng.normal()
    variants = [
        {
            "name": name,
            "checks": checks or {"slope": None, "own_variance": None, "mean": None},
            "spp": [
                {
                    "spp": spp,
                    "runs": RUNS,
                    "mean_over_reference": estimate(1 + shift + (bias or {}).get(name, 0.0)),
                    "mse_over_variance": estimate(1.0),
                }
                for spp in SPP
            ],
        }
        for name in VARIANTS
    ]
    reference = {"mean": 2.0, "mean_error": 2.0 * of_reference, "rmse": 1.0}
    return {"scenes": [{"name": "s", "reference": reference, "variants": variants}]}


@pytest.mark.parametrize("of_reference", [0.0, 0.02])
def test_marks_without_reason_are_as_rare_as_promised(of_reference):
    """At most ALPHA of runs, to four standard deviations of the count."""
    rng = np.random.default_rng(7)
    n = 400
    marked = sum(bool(departures(results(rng, of_reference=of_reference))) for _ in range(n))
    assert marked <= n * ALPHA + 4 * np.sqrt(n * ALPHA)


def test_a_sampler_that_loses_four_percent_of_the_light_is_marked():
    rng = np.random.default_rng(7)
    found = departures(results(rng, {"b": -0.04}, spread=0.002))
    assert list(found) == [("s", "b")]
    assert all(
        text.startswith("mean radiance over that of the reference 0.9") for text in found["s", "b"]
    )


def test_measures_that_say_nothing_mark_nothing():
    rng = np.random.default_rng(7)
    says_nothing = {"slope": "Sobol", "own_variance": "Sobol", "mean": "other settings"}
    assert departures(results(rng, {"b": -0.5}, checks=says_nothing)) == {}


@pytest.mark.parametrize(
    ("suffix", "there", "not_there"),
    [(".pdf", b"/Type42|/TrueType|FontFile2", b"/Type3"), (".svg", b"<text", b"nothing")],
)
def test_letters_of_figures_are_letters(tmp_path, suffix, there, not_there):
    figure = Figure(figsize=(2, 1))
    figure.subplots().set_title("RMSE over time")
    save(figure, tmp_path / f"a{suffix}")
    data = (tmp_path / f"a{suffix}").read_bytes()
    assert any(word in data for word in there.split(b"|"))
    assert not_there not in data
