"""Fibre parameters: validation, presets and provenance."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import RANGES, Fibre


def test_every_preset_says_where_it_is_from() -> None:
    """In its provenance and, by name, in the documentation of Fibre.preset."""
    for name in Fibre.preset_names():
        assert Fibre.preset(name).provenance != Fibre().provenance
        assert f"``{name}``" in (Fibre.preset.__doc__ or "")


def test_hair_colours_are_ordered() -> None:
    """Darker hair absorbs more in every channel; red hair is the reddest."""
    black, brown, blond, red = (
        np.array(Fibre.preset(n).sigma_ca) for n in ("black", "brown", "blond", "red")
    )
    assert np.all(black > brown)
    assert np.all(brown > blond)
    assert red[2] / red[0] > max(s[2] / s[0] for s in (black, brown, blond))
    assert Fibre.preset("white") == Fibre.preset("human-white")


def test_one_number_stands_for_three() -> None:
    assert Fibre(sigma_ca=2, sigma_ma=np.float32(0.5)) == Fibre(  # type: ignore[arg-type]
        sigma_ca=(2, 2, 2), sigma_ma=(0.5, 0.5, 0.5)
    )
    assert Fibre(sigma_ca=np.array([1.0, 2.0, 3.0])).sigma_ca == (1.0, 2.0, 3.0)  # type: ignore[arg-type]


def test_replace_keeps_the_rest_and_says_so() -> None:
    fox = Fibre.preset("red-fox", sigma_ms=1.0).replace(g=0.1)
    assert (fox.sigma_ms, fox.g, fox.kappa) == (1.0, 0.1, 0.86)
    assert fox.provenance.startswith("second-hand")
    assert fox.provenance.endswith("changed: sigma_ms; changed: g")
    assert fox.replace() == fox
    assert fox.replace().provenance == fox.provenance
    assert fox != Fibre.preset("red-fox")
    mine = Fibre.preset("red-fox").replace(provenance="mine")
    assert (mine, mine.provenance) == (Fibre.preset("red-fox"), "mine")


def test_values_are_plain_and_hashable() -> None:
    f = Fibre(eta=np.float32(1.5), kappa=1)  # type: ignore[arg-type]
    values = [getattr(f, field.name) for field in dataclasses.fields(f)]
    assert {type(v) for v in values} == {float, tuple, str}
    assert hash(f) == hash(Fibre(eta=1.5, kappa=1.0, provenance="other"))


def test_radians() -> None:
    f = Fibre(alpha_deg=4, beta_m_deg=10, beta_n_deg=20)
    assert (f.alpha, f.beta_m, f.beta_n) == pytest.approx(
        (math.radians(4), math.radians(10), math.radians(20))
    )
    assert f.tilt == f.replace(alpha_deg=-4).tilt == -f.alpha


@pytest.mark.parametrize("name", RANGES)
@pytest.mark.parametrize("end", [0, 1])
def test_range_ends(name: str, end: int) -> None:
    """The ends themselves are allowed; a little beyond is refused with name, value and range."""
    low, high = RANGES[name]
    inside: dict[str, Any] = {name: RANGES[name][end]}
    beyond: dict[str, Any] = {name: RANGES[name][end] + (1e-6 if end else -1e-6)}
    Fibre(**inside)
    with pytest.raises(FibreError, match=rf"fibre\.{name} = .*from {low:g} to {high:g}"):
        Fibre(**beyond)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"eta": math.nan}, "fibre.eta = nan - allowed is a number from 1.0001 to 3"),
        ({"kappa": math.inf}, "fibre.kappa = inf"),
        ({"kappa": True}, "fibre.kappa = True"),
        ({"kappa": "0.5"}, "fibre.kappa = '0.5'"),
        ({"sigma_ms": (1, 2, 3)}, r"fibre.sigma_ms = \(1, 2, 3\) - allowed is a number"),
        ({"sigma_ca": "red"}, "fibre.sigma_ca = 'red' - allowed is one number or three"),
        ({"sigma_ca": (1, 2)}, r"fibre.sigma_ca = \(1, 2\) - allowed is one number or three"),
        ({"sigma_ma": (1, 2, -3)}, "fibre.sigma_ma = -3 - allowed is a number from 0 to 10000"),
        ({"sigma_ma": None}, "fibre.sigma_ma = None"),
    ],
)
def test_refusals(changes: dict, message: str) -> None:
    with pytest.raises(FibreError, match=message):
        Fibre(**changes)


@pytest.mark.parametrize(
    ("name", "near"),
    [("redfox", "red-fox"), ("human_white", "human-white"), ("Racoon", "raccoon"), ("", "black")],
)
def test_unknown_preset_names_the_nearest(name: str, near: str) -> None:
    with pytest.raises(FibreError) as caught:
        Fibre.preset(name)
    assert f"fibre.preset = {name!r}" in str(caught.value)
    assert "did you mean" in str(caught.value)
    if name:
        assert f"did you mean {near!r}" in str(caught.value)


def test_unknown_parameter_names_the_nearest() -> None:
    with pytest.raises(
        FibreError, match=r"fibre\.alpha is not a parameter - did you mean alpha_deg"
    ):
        Fibre.preset("red-fox", alpha=3)
