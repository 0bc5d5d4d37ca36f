"""Figures of docs/models/: the lobes of a model around the fibre and along it.

python bench/model_lobes.py [MODEL...] [-o docs/figures]
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from model_figures import DECADES, DIRECTIONS
from PIL import Image

from furcl.fibre import model as models
from furcl.fibre.chiang.parameters import ChiangFibre
from furcl.fibre.closed.reference import ClosedReference
from furcl.fibre.deon.parameters import DEonFibre
from furcl.fibre.marschner.parameters import MarschnerFibre
from furcl.fibre.sadeghi.parameters import SadeghiFibre
from furcl.fibre.yan2015.parameters import Yan2015Fibre
from furcl.report.convergence_plots import STYLES, save

GREY = (0.2, 0.2, 0.2)
FIBRES: dict[str, Any] = {
    "chiang": ChiangFibre(sigma_a=GREY),
    "deon": DEonFibre(sigma_a=GREY, orders=4),
    "marschner": MarschnerFibre(sigma_a=GREY),
    "sadeghi": SadeghiFibre(),
    # A clear medulla: the profiles of one that scatters are simulated (bench/model_figures.py).
    "yan2015": Yan2015Fibre(eta_m=1.2, kappa=0.7, sigma_ca=GREY, sigma_ms=0.0),
}
THETA = np.radians(20.0)
NODES = 64  # over h
INCLINATIONS = 480  # of wi, for what is integrated over one


def values(fibre: Any, theta: float, theta_o: np.ndarray, phi: np.ndarray) -> dict[str, np.ndarray]:
    """The far field of every lobe (len(theta_o), len(phi)) [1/sr], first channel."""
    reference = import_module(models.model_of(fibre).reference)
    closed = isinstance(reference.REFERENCE, ClosedReference)
    x, w = np.polynomial.legendre.leggauss(1 if closed else NODES)
    h, weight = np.sin(0.5 * np.pi * x), 0.25 * np.pi * w * np.cos(0.5 * np.pi * x)
    weight /= weight.sum()
    wo = np.array([np.sin(theta), np.cos(theta), 0.0])
    out, azimuth = np.meshgrid(theta_o, phi, indexing="ij")
    c = np.cos(out)
    wi = np.stack([np.sin(out), c * np.cos(azimuth), c * np.sin(azimuth)], -1)
    found = {}
    energies = reference.attenuation(fibre, h, theta, residual=True)
    for lobe in (name for name, energy in energies.items() if energy.any()):
        total = np.zeros(out.shape)
        for offset, share in zip(h, weight, strict=True):
            total += share * reference.evaluate(fibre, wo, wi, offset, lobe=lobe)[..., 0]
        found[lobe] = total
    return found


def figure_of(fibre: Any) -> Figure:
    """Around the fibre, all inclinations together, and along it, all azimuths."""
    figure = Figure(figsize=(8.6, 4.4), layout="constrained")
    around = figure.add_subplot(1, 2, 1, projection="polar")
    along = figure.add_subplot(1, 2, 2)
    theta_o = np.linspace(-0.5 * np.pi, 0.5 * np.pi, INCLINATIONS + 1)
    # Half a turn, which the other half mirrors.
    phi = (np.arange(180) + 0.5) * (np.pi / 180)
    turn = np.concatenate([-phi[::-1], phi])
    low, high = np.log10(DECADES)
    for number, (lobe, f) in enumerate(values(fibre, float(THETA), theta_o, phi).items()):
        colour = STYLES[number % len(STYLES)][0]
        line = "-" if number < len(STYLES) else "--"
        of_phi = np.trapezoid(f * np.cos(theta_o)[:, None], theta_o, axis=0)
        radius = np.clip(np.log10(np.maximum(of_phi, 1e-30)), low, high)
        radius = np.concatenate([radius[::-1], radius])
        around.plot(turn, radius, color=colour, lw=1.6, ls=line, label=lobe)
        of_theta = 2.0 * np.pi * f.mean(axis=1) * np.cos(theta_o)
        along.plot(np.degrees(theta_o), of_theta, color=colour, lw=1.6, ls=line)
    around.set(ylim=(low, high))
    decades = np.arange(low, high + 0.5)
    labels = [f"{10.0**decade:g}" for decade in decades]
    around.set_rgrids(decades, labels, angle=68, fontsize=8, color="0.35")  # pyright: ignore
    around.set_thetagrids(np.arange(0, 360, 45), DIRECTIONS, fontsize=8)  # pyright: ignore
    around.grid(lw=0.4, alpha=0.5)
    along.set(
        xlabel="inclination of wi [deg]", ylabel="per radian", yscale="log", ylim=(1e-4, 10.0)
    )
    powers = [10.0**decade for decade in range(-4, 2)]
    along.set_yticks(powers, [f"{power:g}" for power in powers])
    along.minorticks_off()
    along.axvline(-np.degrees(THETA), color="0.6", lw=0.8)
    along.grid(lw=0.4, alpha=0.5)
    figure.legend(*around.get_legend_handles_labels(), loc="outside lower center", ncols=6)
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("models", nargs="*", help=", ".join(FIBRES))
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/figures"))
    asked = parser.parse_args()
    for name in asked.models or FIBRES:
        path = asked.output / f"model_{name}.png"
        save(figure_of(FIBRES[name]), path, dpi=100)
        picture = Image.open(path).convert("RGB").quantize(64, dither=Image.Dither.NONE)
        picture.save(path, optimize=True)
        print(path)
