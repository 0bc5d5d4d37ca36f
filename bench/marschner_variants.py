"""What the parts of Marschner's paper that scenes leave out would change, for
docs/models/marschner.md.

python bench/marschner_variants.py

In float64, in the plane across a fibre of eta 1.55. The cubic: how far it moves the azimuths of TRT
and its caustic. The ellipse: between which azimuths the caustic lies as the axes turn, and how much
of the light of TRT leaves elsewhere than from a circle, of one fibre and of fibres whose axes lie
at random.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.marschner.azimuth import azimuth, caustic
from furcl.fibre.marschner.parameters import MarschnerFibre
from furcl.fibre.marschner.reference import elliptical

Array = NDArray[np.float64]

ETA = 1.55
RATIOS = (0.95, 0.9, 0.85, 0.8)
FIBRE = MarschnerFibre(eta=ETA, sigma_a=(0.4, 0.4, 0.4))
N_PHI, N_TURNS = 720, 48


def cubic(gamma: Array, index: float) -> Array:
    """Azimuth of TRT by the paper's cubic."""
    c = np.arcsin(1.0 / index)
    return (12.0 * c / np.pi - 2.0) * gamma - 16.0 * c / np.pi**3 * gamma**3


def around(fibre: MarschnerFibre, turn: float) -> Array:
    """TRT by azimuth (N_PHI,), seen from an angle to the minor axis [rad]."""
    phi = (np.arange(N_PHI) + 0.5) * (2.0 * np.pi / N_PHI) + turn
    # Where the lobe along the fibre is centred.
    sine = float(np.sin(2.0 * fibre.lobes[2].shift))
    wi = np.stack(
        [np.full(N_PHI, sine), *(np.sqrt(1.0 - sine**2) * f(phi) for f in (np.cos, np.sin))]
    )
    return elliptical(fibre, [0.0, np.cos(turn), np.sin(turn)], wi.T)[:, 0]


def moved(light: Array, circle: Array) -> float:
    """Share of the light that leaves elsewhere: half the sum of the differences, both of sum 1."""
    return float(0.5 * np.abs(light / light.sum() - circle / circle.sum()).sum())


def main() -> None:
    gamma = np.linspace(0.0, np.pi / 2, 20_001)
    exact, approximate = azimuth(2, gamma, np.array(ETA)), cubic(gamma, ETA)
    degrees = np.degrees([exact.max(), approximate.max(), np.abs(exact - approximate).max()])
    print(
        "cubic: caustic at {1:.1f} deg, exactly {0:.1f}; off by up to {2:.1f} deg".format(*degrees)
    )
    circle = around(FIBRE, 0.0)
    print("axis ratio | caustic, deg | moved, one fibre | moved, axes at random | over a circle's")
    for ratio in RATIOS:
        fibre = MarschnerFibre(eta=ETA, sigma_a=FIBRE.sigma_a, axis_ratio=ratio)
        indices = [2.0 * (ETA - 1.0) * s - ETA + 2.0 for s in (ratio**2, ratio**-2)]
        ends = [float(np.degrees(caustic(fibre, np.array(0.0), np.array(i)).phi)) for i in indices]
        each = [around(fibre, turn) for turn in np.pi * (np.arange(N_TURNS) + 0.5) / N_TURNS]
        one = float(np.mean([moved(light, circle) for light in each]))
        mean = np.mean(each, axis=0)
        print(
            f"{ratio:g} | {ends[1]:.1f} to {ends[0]:.1f} | {one:.0%} | {moved(mean, circle):.0%} | "
            f"{mean.sum() / circle.sum():.2f}"
        )


if __name__ == "__main__":
    main()
