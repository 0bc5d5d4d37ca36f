"""Figures of docs/model.md: far field, medulla profiles, attenuation over h.

python bench/model_figures.py [-o docs/figures] [--device TEXT]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from furcl import bcsdf
from furcl.device.choice import open_device
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles, build_profiles
from furcl.report.convergence_plots import STYLES, save

PRESETS = ("human-black", "human-white", "raccoon")
LABELS = {"R": "R", "TT": "TT", "TRT": "TRT", "TTs": "TTˢ", "TRTs": "TRTˢ"}
COLOURS = {name: STYLES[i][0] for i, name in enumerate(bcsdf.LOBES)}
THETA = np.radians(30.0)
DECADES = (1e-4, 1.0)
DIRECTIONS = ("0°\nback", "45°", "90°", "135°", "180°\nthrough", "-135°", "-90°", "-45°")


def far_field(
    fibre: Fibre, profiles: MedullaProfiles | None, theta: float, phi: np.ndarray
) -> dict[str, np.ndarray]:
    """N_p (phi,) of every lobe: mean over h of A_p D_p, mean of the channels."""
    x, w = np.polynomial.legendre.leggauss(256)
    gamma = 0.5 * np.pi * x
    h, weight = np.sin(gamma), 0.25 * np.pi * w * np.cos(gamma)
    energy = bcsdf.attenuation(fibre, h, theta, profiles)
    geo = bcsdf.geometry(fibre, h, theta)
    result = {}
    for p, name in enumerate(("R", "TT", "TRT")):
        density = bcsdf.D_p(fibre, p, phi[:, None] - geo.Phi(p))
        result[name] = density @ (weight * energy[name].mean(-1))
    # Over s the scattered lobes are constant in 64 bins.
    s = (np.arange(64) + 0.5) / 32 - 1
    c = np.sqrt(1 - s * s)
    wi = np.stack([s + 0 * phi[:, None], c * np.cos(phi[:, None]), c * np.sin(phi[:, None])], -1)
    wo = np.array([np.sin(theta), np.cos(theta), 0.0])
    for name in ("TTs", "TRTs"):
        result[name] = np.zeros(phi.size)
        for offset, part in zip(h, weight, strict=True):
            value = bcsdf.evaluate(fibre, wo, wi, offset, profiles, lobe=name)
            result[name] += part * value.mean(-1).sum(-1) / 32
    return result


def polar_figure(materials: dict[str, tuple[Fibre, MedullaProfiles | None]]) -> Figure:
    """N_p(phi) in polar coordinates with a logarithmic radius."""
    figure = Figure(figsize=(8.0, 8.4), layout="constrained")
    phi = np.linspace(-np.pi, np.pi, 361)
    low, high = np.log10(DECADES)
    for place, (name, (fibre, profiles)) in enumerate(materials.items()):
        axes = figure.add_subplot(2, 2, place + 1, projection="polar")
        for lobe, values in far_field(fibre, profiles, float(THETA), phi).items():
            radius = np.clip(np.log10(np.maximum(values, 1e-30)), low, high)
            axes.plot(phi, radius, color=COLOURS[lobe], lw=1.6, label=LABELS[lobe])
        axes.set(ylim=(low, high), title=name)
        decades = np.arange(low, high + 0.5)
        labels = [f"$10^{{{decade:.0f}}}$" for decade in decades]
        axes.set_rgrids(decades, labels, angle=68, fontsize=8, color="0.35")  # pyright: ignore
        axes.set_thetagrids(np.arange(0, 360, 45), DIRECTIONS, fontsize=8)  # pyright: ignore
        axes.grid(lw=0.4, alpha=0.5)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return figure


def profile_figure(materials: dict[str, tuple[Fibre, MedullaProfiles | None]]) -> Figure:
    """The medulla's profiles: Dhat over phi_q above, M^s over s below."""
    figure = Figure(figsize=(10.5, 6.0), layout="constrained")
    grid = figure.subplots(2, len(materials))
    for (name, (fibre, profiles)), upper, lower in zip(
        materials.items(), grid[0], grid[1], strict=True
    ):
        assert profiles is not None
        _draw_azimuth(upper, profiles)
        _draw_longitudinal(lower, profiles)
        optical = fibre.kappa * fibre.sigma_ms
        upper.set_title(f"{name}: $\\tau$ = {optical:.2f}, g = {fibre.g:g}", fontsize=10)
    grid[0, 0].set_ylabel("$\\hat{D}$  [1/rad]")
    grid[1, 0].set_ylabel("$M^s$  [per unit of s]")
    grid[0, 0].legend(fontsize=8, title="h' / κ", title_fontsize=8)
    grid[1, 0].legend(fontsize=8, loc="lower center")
    return figure


def _draw_azimuth(axes: Axes, profiles: MedullaProfiles) -> None:
    density = profiles.azimuth.density[0]
    n_h, n_phi = density.shape
    edges = np.degrees(np.linspace(-np.pi, np.pi, n_phi + 1))
    for colour, row in zip(("#0072B2", "#D55E00", "#009E73"), (0, 11, 22), strict=True):
        offset = np.sin(0.5 * np.pi * row / (n_h - 1))
        axes.stairs(density[row], edges, color=colour, lw=1.3, baseline=None, label=f"{offset:.2f}")
    axes.set(xlim=(-180, 180), ylim=(0, None), xlabel="$\\phi_q$ [deg], ±180 is straight through")
    axes.set_xticks(range(-180, 181, 90))
    _plain(axes)


def _draw_longitudinal(axes: Axes, profiles: MedullaProfiles) -> None:
    density = profiles.longitudinal.density
    n_theta, _, n_s = density.shape
    edges = np.linspace(-1, 1, n_s + 1)
    for colour, row in zip(("#0072B2", "#D55E00"), (0, 10), strict=True):
        degrees = 90.0 * row / (n_theta - 1)
        for end, style, label in ((0, "-", "back"), (1, "--", "front")):
            axes.stairs(
                density[row, end], edges, color=colour, lw=1.3, ls=style, baseline=None,
                label=f"θ = {degrees:.0f}°, {label}",
            )  # fmt: skip
    axes.set(xlim=(-1, 1), ylim=(0, None), xlabel="$s = \\sin\\theta_o$")
    _plain(axes)


def attenuation_figure(materials: dict[str, tuple[Fibre, MedullaProfiles | None]]) -> Figure:
    """A_p over h at theta = 0, as the paper's figure 4; below with a logarithmic scale."""
    figure = Figure(figsize=(10.5, 5.6), layout="constrained")
    h = np.linspace(-1, 1, 801)
    grid = figure.subplots(2, len(materials), sharex=True, sharey="row")
    for column, (name, (fibre, profiles)) in zip(grid.T, materials.items(), strict=True):
        for lobe, values in bcsdf.attenuation(fibre, h, 0.0, profiles).items():
            for axes in column:
                axes.plot(h, values.mean(-1), color=COLOURS[lobe], lw=1.6, label=LABELS[lobe])
                _plain(axes)
        column[0].set(xlim=(-1, 1), ylim=(0, 1), title=name)
        column[1].set(yscale="log", ylim=(1e-4, 1), xlabel="h")
    for axes in grid[:, 0]:
        axes.set_ylabel("$A_p(h)$")
    grid[0, 0].legend(fontsize=8, loc="upper center")
    return figure


def _plain(axes: Axes) -> None:
    axes.grid(lw=0.4, alpha=0.4)
    axes.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Draw all figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    default = Path(__file__).parents[1] / "docs" / "figures"
    parser.add_argument("-o", "--output", type=Path, default=default)
    parser.add_argument("--device", default="", help="as for furcl render")
    options = parser.parse_args()
    device = open_device(options.device or None)
    fibres = {name: Fibre.preset(name) for name in (*PRESETS, "red-fox")}
    materials = {name: (fibre, build_profiles(device, fibre)) for name, fibre in fibres.items()}
    options.output.mkdir(parents=True, exist_ok=True)
    figures = {
        "far_field": polar_figure({name: materials[name] for name in materials}),
        "attenuation": attenuation_figure({name: materials[name] for name in PRESETS}),
        "profiles": profile_figure(
            {name: materials[name] for name in ("human-white", "raccoon", "red-fox")}
        ),
    }
    for name, figure in figures.items():
        path = options.output / f"model_{name}.png"
        save(figure, path, dpi=110)
        picture = Image.open(path).convert("RGB").quantize(64, dither=Image.Dither.NONE)
        picture.save(path, optimize=True)
        print(path)


if __name__ == "__main__":
    main()
