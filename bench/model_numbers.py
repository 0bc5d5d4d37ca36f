"""Numbers of docs/model.md that no other command prints: what each choice of the model changes.

python bench/model_numbers.py [--device TEXT]
"""

from __future__ import annotations

import argparse
from unittest import mock

import numpy as np

from furcl import bcsdf
from furcl.device.choice import Device, open_device
from furcl.device.features import Features
from furcl.device.memory import Memory
from furcl.fibre import samplers
from furcl.fibre.attenuation import tables_from_bins as from_bins
from furcl.fibre.double_cylinder import medulla_walk
from furcl.fibre.double_cylinder.paper import LOBE_SHARES
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles, build_profiles
from furcl.fibre.double_cylinder.reference.angles import wrapped_gaussian
from furcl.fibre.double_cylinder.reference.energy import nodes_over_h
from furcl.fibre.material import build_material
from furcl.rendering.probe import Probe

PRESETS = ("human-white", "human-black", "raccoon", "red-fox", "unlabelled-a", "unlabelled-b")


def percent(values) -> str:
    """Numbers as percentages with three digits."""
    return ", ".join(f"{100 * float(v):.3g} %" for v in np.atleast_1d(values))


def slab(r):
    """Reflectance of a slab whose interfaces reflect r."""
    return 2 * r / (1 + r)


def stack(r, layers):
    """Reflectance of `layers` plates that reflect r each."""
    return layers * r / (1 + (layers - 1) * r)


def interface(eta, cos):
    """Fresnel reflectances (s, p) at relative index eta, cosine of incidence."""
    n = np.sqrt(eta**2 - 1 + cos**2)
    return ((cos - n) / (cos + n)) ** 2, ((eta**2 * cos - n) / (eta**2 * cos + n)) ** 2


def fresnel(device: Device) -> None:
    """Cuticle: dimensions, slab, order of averaging."""
    h, theta = np.array([0.0, 0.6, 0.95]), np.radians(75)
    fibre = Fibre(eta=1.55, layers=0.68)
    flat = np.sqrt(fibre.eta**2 - np.sin(theta) ** 2) / np.cos(theta)
    both = [slab(r) for r in interface(flat, np.sqrt(1 - h * h))]
    print("eta 1.55, l 0.68, theta 75, h 0, 0.6, 0.95:")
    print("  reflectance from the projected angle:", stack(np.mean(both, 0), 0.68).round(2))
    print("  in three dimensions:", bcsdf.cuticle(fibre, h, theta)[0].round(2))
    r = np.array(interface(1.55, 1.0)[0])
    print(f"normal incidence: {stack(r, 0.68):.3f} without, {stack(slab(r), 0.68):.3f} with slabs")
    s, p = (slab(r) for r in interface(1.55, np.sqrt(1 - 0.95**2)))
    first, last = stack((s + p) / 2, 0.68), (stack(s, 0.68) + stack(p, 0.68)) / 2
    print(f"h 0.95, theta 0: {first:.4f} averaged before, {last:.4f} after stacking")


def gaussians(device: Device) -> None:
    """Shapes of the lobes."""
    phi = np.linspace(-np.pi, np.pi, 721)
    for beta in (2.5, 3.0):
        off = np.max(np.abs(wrapped_gaussian(phi, beta) * 2 * np.pi - 1))
        print(f"wrapped Gaussian of {beta} rad: 1/(2 pi) is off by", percent(off))
    exact = wrapped_gaussian(phi, 1.5)
    images = sum(np.exp(-((phi + k) ** 2) / 4.5) for k in (-2 * np.pi, 0, 2 * np.pi))
    images = images / (1.5 * np.sqrt(2 * np.pi))
    b = np.exp(-0.5 * 1.5**2)
    series = (1 + 2 * sum(b ** (k * k) * np.cos(k * phi) for k in (1, 2, 3))) / (2 * np.pi)
    for name, found in (("three images", images), ("three terms", series)):
        error = np.max(np.abs(found - exact)) * 2 * np.pi
        print(f"  at 1.5 rad {name}: off by {error:.1e} of 1/(2 pi)")
    x = np.random.default_rng(1).normal(1.5, 0.3, 10**6)
    inside = np.mean(np.abs(x) < np.pi / 2)
    print("Gaussian of 0.3 rad at 1.5 rad: share inside +-90 degrees", f"{inside:.2f}")


def tilts(device: Device) -> None:
    """Tilt of the scattered lobes on both sides instead of on the known one."""
    edge = np.linspace(-np.pi / 2, np.pi / 2, 20001)
    theta_o = 0.5 * (edge[1:] + edge[:-1])
    for name in PRESETS:
        fibre = Fibre.preset(name)
        profiles = build_profiles(device, fibre)
        assert profiles is not None
        s = np.sin(theta_o - fibre.tilt)
        bins = np.minimum(((s + 1) * 32).astype(int), 63)
        density = profiles.longitudinal.density[..., bins]
        total = (density * np.diff(np.sin(edge))).sum(-1) - 1
        at = np.degrees(np.linspace(0, np.pi / 2, len(total)))
        ends = [total[np.abs(at) <= 66].min(), total[np.abs(at) <= 66].max(), total.min()]
        print(
            f"{name}, tilt {fibre.alpha_deg:g} degrees on both sides: energy of M^s changes by",
            f"{percent(ends[0])} to {percent(ends[1])} up to theta 66, {percent(ends[2])} at worst",
        )


def absorption(device: Device) -> None:
    """Medulla absorption: exp(-kappa sigma_ma) against the simulated escaping share."""
    for name in ("raccoon", "red-fox"):
        fibre = Fibre.preset(name)
        profiles = build_profiles(device, fibre)
        assert profiles is not None
        assert profiles.escape is not None
        exact = bcsdf.lobe_albedos(fibre, 0.0, profiles)["TTs"].mean()
        free = fibre.replace(sigma_ma=0.0)
        white = bcsdf.lobe_albedos(free, 0.0, build_profiles(device, free))["TTs"].mean()
        simple = float(np.exp(-fibre.kappa * fibre.sigma_ma[0]))
        print(
            f"{name}, theta 0: {exact / white:.3f} of TTs escapes, exp(-kappa sigma_ma) says",
            end="",
        )
        print(f" {simple:.3f}")
    for sigma_ma in (0.392, 0.2):
        fibre = Fibre.preset("raccoon", sigma_ma=sigma_ma)
        shares = bcsdf.lobe_shares(fibre, build_profiles(device, fibre))
        print(f"raccoon, sigma_ma {sigma_ma:g}: shares", percent(list(shares.values())))
    print("raccoon in the paper: shares", percent(np.array(LOBE_SHARES["raccoon"]) / 100))


def _quadrature(fibre: Fibre, theta: float):
    h, weight, _ = nodes_over_h(fibre, theta, 1, 64)
    reflected, passed = bcsdf.cuticle(fibre, h, theta)
    return bcsdf.geometry(fibre, h, theta), weight, reflected, passed


def energies(device: Device) -> None:
    """What the five lobes lose, and what forgetting q would gain."""
    for name in PRESETS:
        fibre = Fibre.preset(name, sigma_ca=0.0, sigma_ma=0.0)
        lost = []
        for theta in np.radians([0, 45, 75, 85]):
            geo, weight, f, passed = _quadrature(fibre, float(theta))
            t = np.exp(-2 * geo.medulla * fibre.sigma_ms / geo.cos_theta_t)
            lost.append(np.sum(weight * passed * f**2 * t**2))
        print(f"{name} without absorption, missing at theta 0, 45, 75, 85:", percent(lost))
    fibre = Fibre(eta=1.55, kappa=0.8, sigma_ms=0.5)
    geo, weight, f, passed = _quadrature(fibre, 0.0)
    t = np.exp(-2 * geo.medulla * fibre.sigma_ms)
    scattered = np.where(geo.medulla > 0, passed * (1 + f * t), 0.0)
    total = np.sum(weight * (f + passed**2 * t * (1 + f * t) + scattered))
    print(f"kappa 0.8, sigma_ms 0.5, q forgotten: a white fibre returns {total:.2f}")


def dense(device: Device) -> None:
    """The cap on the optical radius of a medulla that is walked."""
    a = 160.0 / 99.0  # an albedo of 0.99
    fibre = Fibre(kappa=1.0, sigma_ms=160.0, sigma_ma=(a, a, a))
    capped = _walked(device, fibre, medulla_walk.OPTICAL_RADIUS_CAP)
    full = _walked(device, fibre, 1e9)
    octants = [p.azimuth.density.reshape(4, 32, 8, 16).mean(-1) * 2 * np.pi for p in (capped, full)]
    off = np.abs(octants[0] - octants[1])
    assert capped.escape is not None
    assert full.escape is not None
    escape = np.abs(capped.escape - full.escape).max()
    print(
        f"optical radius 160 walked with {medulla_walk.OPTICAL_RADIUS_CAP:g}: octants of Dhat off "
        f"by {percent(off.max())} of their mean at most, {percent(off.mean())} on average, "
        f"the escaping share by {escape:.3f} at most"
    )


def _walked(device: Device, fibre: Fibre, cap: float) -> MedullaProfiles:
    with (
        mock.patch.object(medulla_walk, "OPTICAL_RADIUS_CAP", cap),
        mock.patch.object(medulla_walk, "TAU_CAP", 1e9),
    ):
        profiles = build_profiles(device, fibre, photons=1920, cache=False)
    assert profiles is not None
    return profiles


def lobes(device: Device) -> None:
    """Lobes that a render of a preset leaves out."""
    for name in PRESETS:
        fibre = Fibre.preset(name)
        sampler = samplers.find("full-cdf")
        material = build_material(Memory(device), fibre, Features(), sampler, drop_lobes=True)
        dropped = material.fibre_features.dropped_lobes
        print(f"{name}: leaves out", ", ".join(dropped) or "no lobe")


def weights(device: Device) -> None:
    """Tables with and without the peaks of their bins: second moment and largest of the weights."""
    fibres = {name: Fibre.preset(name) for name in PRESETS[:4]}
    fibres |= {"eta 1.0001": Fibre(eta=1.0001), "l 0.001": Fibre(layers=1e-3)}
    means_only = mock.patch(
        "furcl.fibre.material.tables_from_bins", lambda means, _: from_bins(means)
    )
    for name, fibre in fibres.items():
        with means_only:
            plain = Probe(fibre, device=device, residual=True)
        probe = Probe(fibre, device=device, residual=True)
        assert plain.material.tables is not None
        assert probe.material.tables is not None
        added = probe.material.tables.energy / plain.material.tables.energy - 1.0
        print(
            f"{name}: energy added at theta 0", percent(added[0]), "at most", percent(added.max())
        )
        for degrees in (0, 45, 75, 89):
            theta = np.radians(degrees)
            wo = np.array([np.sin(theta), np.cos(theta), 0.0])
            line = f"  theta {degrees}, second moment and largest over the mean:"
            for which in (plain, probe):
                weight = which.sample(wo, n=1_000_000, seed=1)[3].mean(1).astype(np.float64)
                mean = weight.mean()
                line += f" {(weight**2).mean() / mean**2:.3f} {weight.max() / mean:.3g}"
            print(line)


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--device", default="", help="as for furcl render")
    device = open_device(parser.parse_args().device or None)
    for part in (fresnel, gaussians, tilts, absorption, energies, lobes, dense, weights):
        print(f"\n{part.__doc__}")
        part(device)


if __name__ == "__main__":
    main()
