"""Pigment, target colour, sRGB and luminance."""

import math

import numpy as np
import pytest

from furcl.errors import FibreError
from furcl.fibre.pigment import (
    chiang_roughness,
    colour_from_sigma_ca,
    sigma_ca_from_colour,
    sigma_ca_from_melanin,
)
from furcl.image.colour import luminance, srgb_decode, srgb_encode


@pytest.mark.parametrize(
    ("eumelanin", "pheomelanin", "expected"),
    [
        (0, 0, (0, 0, 0)),
        (1, 0, (0.419, 0.697, 1.37)),
        (0, 1, (0.187, 0.4, 1.05)),
        (1.3, 0.2, (0.5821, 0.9861, 1.991)),
    ],
)
def test_melanin(eumelanin: float, pheomelanin: float, expected: tuple) -> None:
    assert sigma_ca_from_melanin(eumelanin, pheomelanin) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("bad", [-0.1, 101.0, math.nan, math.inf])
def test_melanin_range(bad: float) -> None:
    with pytest.raises(FibreError, match=r"fibre\.eumelanin"):
        sigma_ca_from_melanin(bad)
    with pytest.raises(FibreError, match=r"fibre\.pheomelanin"):
        sigma_ca_from_melanin(0.1, bad)


@pytest.mark.parametrize("b", [0.05, 0.1, 0.3, 0.7, 1.0])
def test_roughness_has_the_deviation_of_the_logistic(b: float) -> None:
    """Forward map by numerical moments of the logistic density."""
    scale = math.sqrt(math.pi / 8) * (0.265 * b + 1.194 * b**2 + 5.372 * b**22)
    x = np.linspace(-60, 60, 200001)
    density = 0.25 / np.cosh(x / 2) ** 2
    deviation = scale * math.sqrt(np.trapezoid(x * x * density, x))
    if math.degrees(deviation) <= 143.0:
        assert chiang_roughness(math.degrees(deviation)) == pytest.approx(b, rel=1e-9)
    else:
        with pytest.raises(FibreError):
            chiang_roughness(math.degrees(deviation))


@pytest.mark.parametrize("beta_n_deg", [0.06, 8.0, 17.63, 60.0, 143.0])
@pytest.mark.parametrize("colour", [(0.8, 0.4, 0.1), (1.0, 1.0, 1e-6), (0.02, 0.5, 0.999)])
def test_target_colour_round_trip(colour: tuple, beta_n_deg: float) -> None:
    sigma = sigma_ca_from_colour(colour, beta_n_deg)
    assert colour_from_sigma_ca(sigma, beta_n_deg) == pytest.approx(colour, rel=1e-12)


def test_target_colour_value() -> None:
    """The polynomial of Chiang et al. written out at b = 0.3."""
    scale = 5.969 - 0.215 * 0.3 + 2.532 * 0.09 - 10.73 * 0.027 + 5.574 * 0.0081 + 0.245 * 0.00243
    logistic = math.sqrt(math.pi / 8) * (0.265 * 0.3 + 1.194 * 0.09 + 5.372 * 0.3**22)
    beta_n_deg = math.degrees(logistic * math.pi / math.sqrt(3))
    expected = (math.log(0.25) / scale) ** 2
    assert sigma_ca_from_colour((0.25,) * 3, beta_n_deg) == pytest.approx((expected,) * 3, rel=1e-9)


@pytest.mark.parametrize(
    ("colour", "beta_n_deg", "message"),
    [
        ((0.5, 0.5, 1.1), 8, "fibre.colour"),
        ((0.0, 0.5, 0.5), 8, "fibre.colour"),
        ((0.5, 0.5), 8, "fibre.colour"),
        ((0.5, 0.5, math.nan), 8, "fibre.colour"),
        ((0.5, 0.5, 0.5), 0.0, "fibre.beta_n_deg"),
        ((0.5, 0.5, 0.5), 144.0, "fibre.beta_n_deg"),
    ],
)
def test_target_colour_refusals(colour: tuple, beta_n_deg: float, message: str) -> None:
    with pytest.raises(FibreError, match=message):
        sigma_ca_from_colour(colour, beta_n_deg)


def test_colour_from_sigma_range() -> None:
    with pytest.raises(FibreError, match=r"fibre\.sigma_ca"):
        colour_from_sigma_ca((1, -1, 1), 8)


def test_srgb_known_points() -> None:
    linear = np.array([0.0, 0.0031308, 0.214041, 1.0])
    assert srgb_encode(linear) == pytest.approx([0.0, 0.0404499, 0.5, 1.0], abs=1e-6)


def test_srgb_round_trip() -> None:
    x = np.linspace(-2.0, 4.0, 6001)
    assert np.allclose(srgb_decode(srgb_encode(x)), x, rtol=1e-12, atol=1e-9)
    assert np.all(np.diff(srgb_encode(x)) > 0)


def test_luminance() -> None:
    assert luminance([1.0, 1.0, 1.0]) == pytest.approx(1.0)
    assert luminance(np.eye(3)) == pytest.approx([0.2126, 0.7152, 0.0722])
    assert luminance(np.ones((4, 5, 3))).shape == (4, 5)
