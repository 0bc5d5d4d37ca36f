"""Fibre parameters: validation, presets and provenance."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import RANGES, Fibre

MEASURED = {
    # kappa, eta, alpha, beta_m, beta_n, sigma_ca, sigma_ms, sigma_ma, g, layers
    "human-white": (0.41, 1.56, 3, 6, 8, (0.41,) * 3, 2.14, (0,) * 3, 0.3, 0.40),
    "human-black": (0.41, 1.56, 3, 6, 8, (4.10,) * 3, 2.14, (0,) * 3, 0.3, 0.40),
    "raccoon": (0.64, 1.452, 3, 8, 10, (0.05,) * 3, 1.564, (0.2,) * 3, 0.4, 0.736),
    "red-fox": (0.86, 1.49, 2.64, 9.45, 17.63, (0.39,) * 3, 3.15, (0.21,) * 3, 0.79, 0.68),
    "unlabelled-a": (0.88, 1.55, 5.48, 11.64, 7.49, (0.64,) * 3, 1.69, (0.17,) * 3, 0.44, 0.47),
    "unlabelled-b": (0.65, 1.19, 1.81, 7.44, 6.88, (0.12, 0.25, 0.37), 2.30, (0.14,) * 3, 0.08, 2),
}


@pytest.mark.parametrize("name", MEASURED)
def test_preset_values(name: str) -> None:
    f = Fibre.preset(name)
    found = (
        f.kappa, f.eta, f.alpha_deg, f.beta_m_deg, f.beta_n_deg,
        f.sigma_ca, f.sigma_ms, f.sigma_ma, f.g, f.layers,
    )  # fmt: skip
    assert found == MEASURED[name]


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("human-white", "fitted"),
        ("human-black", "fitted"),
        ("raccoon", "fitted"),
        ("red-fox", "second-hand"),
        ("unlabelled-a", "unlabelled"),
        ("unlabelled-b", "unlabelled"),
        ("black", "chosen here"),
        ("red", "chosen here"),
    ],
)
def test_provenance_and_docstring(name: str, word: str) -> None:
    assert Fibre.preset(name).provenance.startswith(word)
    assert f"``{name}``" in (Fibre.preset.__doc__ or "")


def test_every_preset_is_documented() -> None:
    missing = [n for n in Fibre.preset_names() if f"``{n}``" not in (Fibre.preset.__doc__ or "")]
    assert missing == []


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
    assert fox.replace() is not None
    assert Fibre.preset("red-fox").replace(provenance="mine") == Fibre.preset("red-fox")


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
