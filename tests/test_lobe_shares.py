"""Lobe shares of the presets, with simulated medulla profiles, against the paper's tables."""

import pytest

from furcl import bcsdf
from furcl.device.choice import Device
from furcl.fibre.double_cylinder.paper import LOBE_SHARES
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import build_profiles

# Points of a hundred by which a share may differ from the paper's. Measured, R to TRTs:
#   human-black  95.75  0.96 0.000  3.29 0.000
#   human-white  14.50 32.87 1.065 51.21 0.360
#   raccoon      14.61 16.64 0.829 67.01 0.914
# The paper samples its own inclinations and bins; TT of black hair and TRTs stay away from it.
BOUNDS = {
    "human-black": (2.2, 2.2, 0.01, 0.1, 0.01),
    "human-white": (1.9, 1.3, 0.1, 0.9, 1.5),
    "raccoon": (0.2, 1.0, 0.25, 0.3, 0.9),
}
# The red fox is a measured set that the paper does not render: held against itself only.
RED_FOX = (17.5, 0.50, 0.0005, 81.9, 0.043)


def _shares(device: Device, fibre: Fibre) -> list[float]:
    # Few photons: shares move by 0.01 points against the tables of a render.
    profiles = build_profiles(device, fibre, photons=384, cache=False)
    shares = bcsdf.lobe_shares(fibre, profiles)
    return [100 * shares[lobe] for lobe in bcsdf.LOBES]


@pytest.mark.parametrize("name", LOBE_SHARES)
def test_shares_of_the_paper(device: Device, name: str) -> None:
    found = _shares(device, Fibre.preset(name))
    for share, paper, bound in zip(found, LOBE_SHARES[name], BOUNDS[name], strict=True):
        assert share == pytest.approx(paper, abs=bound)


def test_red_fox(device: Device) -> None:
    assert _shares(device, Fibre.preset("red-fox")) == pytest.approx(RED_FOX, abs=0.1)


def test_another_absorption_would_show(device: Device) -> None:
    """The raccoon with the sigma_ma of a fit without simulated profiles is three points off."""
    found = _shares(device, Fibre.preset("raccoon", sigma_ma=0.392))
    assert found[0] > LOBE_SHARES["raccoon"][0] + 2.5
    assert found[3] < LOBE_SHARES["raccoon"][3] - 2.5
