"""What tables that are mixed between absorptions bring on a fibre of two colours.

    python bench/absorption_gain.py

Prints, for the light and the dark part of a fibre, the relative deviation of the weights of
attenuation-cdf, root mean square over inclinations: with tables made for each part, with tables
mixed between absorptions, and with one table for all, made for the mean of the two absorptions.
"""

from __future__ import annotations

import numpy as np

from furcl.device.choice import open_device
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.rendering.probe import Probe

LIGHT, DARK = 0.1, 4.0
THETAS = (0.1, 0.5, 0.9, 1.3)
N_SAMPLES = 200_000


def spread(probe: Probe) -> float:
    """Relative standard deviation of the weights, root mean square over THETAS."""
    found = []
    for theta in THETAS:
        wo = np.array([np.sin(theta), np.cos(theta), 0.0])
        weight = probe.sample(wo, n=N_SAMPLES, seed=1)[3].mean(axis=1, dtype=np.float64)
        found.append(weight.std() / weight.mean())
    return float(np.sqrt(np.mean(np.square(found))))


def main() -> None:
    device = open_device(None)
    fibre = Fibre.preset("human-white")
    mean = 0.5 * (LIGHT + DARK)
    print("| absorption | own tables | mixed tables | one table | variance, one over mixed |")
    print("|---|---|---|---|---|")
    for sigma in (LIGHT, DARK):
        own = fibre.replace(sigma_ca=sigma)
        # A fibre outside the range of the tables takes those of its end.
        ranges = (None, (LIGHT, DARK), (mean, 1.001 * mean))
        of = [spread(Probe(own, "attenuation-cdf", device, absorbs=absorbs)) for absorbs in ranges]
        ratio = (of[2] / of[1]) ** 2
        print(f"| {sigma:g} | {of[0]:.3f} | {of[1]:.3f} | {of[2]:.3f} | {ratio:.1f} |")


if __name__ == "__main__":
    main()
