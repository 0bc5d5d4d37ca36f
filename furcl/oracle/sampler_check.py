"""Whether a sampler is unbiased, before anything is rendered with it.

A sampler of one's own is two functions that have to agree (docs/own_sampler.md). The device
functions that a render would run are drawn from and asked, of several fibres and inclinations, and
compared with the float64 references of the models, with quadratures and with each other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from furcl.device.choice import Device, open_device
from furcl.errors import SamplerError
from furcl.fibre import samplers
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.model import model_of
from furcl.fibre.yan2015.parameters import Yan2015Fibre
from furcl.oracle.bcsdf_values import bcsdf_values
from furcl.rendering.probe import Probe
from furcl.values import is_whole, shown

#: Chance that a sampler without bias is named.
ALPHA = 1e-3
SAMPLES = 1 << 17
THETAS_DEG = (0.0, 50.0, -75.0)

_CELLS = 24  # of h, in each lobe
_NODES = 400  # of the midpoint rule in each cell
_LEAST = 20.0  # expected counts of a cell; rarer ones are one cell
_TOWARDS = 3  # directions of light samples, each with _LIGHT_SHARE of the samples
_LIGHT_SHARE = 1 / 4
# What float32 may be off: of means, relative, and of the density of one sample, and how many
# samples may be off by more (those on an edge between two bins).
_MEAN_ROUNDING = 2e-4
_DENSITY_ROUNDING = 1e-2
_ON_EDGES = 1e-3
_TOTAL_ROUNDING = 1e-3


@dataclass(frozen=True)
class Finding:
    """One comparison.

    Attributes
    ----------
    fibre : str, theta_deg : float      what was drawn from, and at which inclination [deg]
    test : str              which comparison
    said : str              what was found, and what it should be
    p : float               chance of as much by accident; of comparisons without chance 1 or 0
    wrong : bool            whether the sampler fails it, at the level of all comparisons together
    """

    fibre: str
    theta_deg: float
    test: str
    said: str
    p: float
    wrong: bool

    def __str__(self) -> str:
        return f"{self.fibre}, {self.theta_deg:g} deg: {self.test}: {self.said}, p = {self.p:.2g}"


@dataclass(frozen=True)
class SamplerCheck:
    """What `check` found of a sampler; `print` it for a table.

    Attributes
    ----------
    name : str              of the sampler
    alpha : float           chance that one without bias fails anything
    findings : tuple        all comparisons
    """

    name: str
    alpha: float
    findings: tuple[Finding, ...]

    @property
    def unbiased(self) -> bool:
        """Whether nothing was found against it."""
        return not self.wrong

    @property
    def wrong(self) -> tuple[Finding, ...]:
        """The comparisons that it fails."""
        return tuple(finding for finding in self.findings if finding.wrong)

    def __str__(self) -> str:
        head = (
            f"{self.name}: nothing is wrong in {len(self.findings)} comparisons; a right sampler "
            f"passes all with a chance of {1.0 - self.alpha:g}"
        )
        if self.wrong:
            head = f"{self.name}: biased: {len(self.wrong)} of {len(self.findings)} comparisons"
        return "\n".join([head, *(f"  {finding}" for finding in self.wrong)])


def default_fibres() -> dict[str, Any]:
    """The fibres that `check` looks at: light, dark, with a medulla, and of a model whose light
    samples use the sampler's h."""
    return {
        "human-white": Fibre.preset("human-white", kappa=0.0),
        "human-black": Fibre.preset("human-black", kappa=0.0),
        "raccoon": Fibre.preset("raccoon"),
        "yan2015": Yan2015Fibre(beta_m_deg=12.0, beta_n_deg=20.0),
    }


def check(
    name: str,
    *,
    fibres: Mapping[str, Any] | None = None,
    thetas_deg: tuple[float, ...] = THETAS_DEG,
    samples: int = SAMPLES,
    alpha: float = ALPHA,
    seed: int = 1,
    device: str | Device | None = None,
) -> SamplerCheck:
    """Say of a sampler whether its samples are of its densities, and its weights of the fibre.

    Of each fibre and inclination:

    - the mean weight is the albedo, which the model's float64 reference integrates (z test);
    - the density that comes with a sample is the one that `joint_densities` gives at its lobe
      and h, and the weight is the value over it;
    - counts of (lobe, h) are those of `joint_densities`, integrated over cells (chi-square);
    - the mean of light samples is the far field of the reference in that direction (z test).

    Each of the m comparisons is made at alpha / m (Bonferroni). tests/test_sampler_check.py has
    samplers with one fault each that must be named.

    Parameters
    ----------
    name : str              of a sampler: registered, or furcl's own
    fibres : mapping        label -> fibre, of any model; left out: `default_fibres`
    thetas_deg : tuple      inclinations of the known direction, -90..90 [deg]
    samples : int           of each fibre and inclination, 1024 or more; 2^17 see a bias of 1 %
                            where weights vary as those of uniform h do
    alpha : float           chance that a sampler without bias is named, 0 to 0.5
    seed : int              0..2^32-1
    device : str, Device or None    as for furcl.render

    Raises
    ------
    SamplerError        an unknown name, or arguments outside their range
    KernelBuildError    the sampler's text does not compile
    FibreError, DeviceError
    """
    samplers.find(name)
    if not 0.0 < alpha < 0.5 or not is_whole(samples) or samples < 1024:
        raise SamplerError(
            f"check of sampler {name!r}: alpha = {shown(alpha)}, samples = {shown(samples)}: "
            f"allowed are 0 to 0.5 and whole numbers of at least 1024"
        )
    fibres = default_fibres() if fibres is None else fibres
    if not fibres or not thetas_deg or not all(abs(angle) <= 90.0 for angle in thetas_deg):
        raise SamplerError(
            f"check of sampler {name!r}: {len(fibres)} fibres, thetas_deg = {shown(thetas_deg)}: "
            f"give one or more of each, inclinations of -90 to 90"
        )
    opened = device if isinstance(device, Device) else open_device(device)
    found: list[tuple[str, float, str, str, float]] = []
    for label, fibre in fibres.items():
        probe = Probe(fibre, name, opened, light_sampling=True)
        for angle in thetas_deg:
            found += ((label, angle, *one) for one in _compare(probe, angle, samples, seed))
            seed = (seed + 1) % (1 << 32)
    level = alpha / len(found)
    return SamplerCheck(
        name,
        alpha,
        tuple(Finding(*finding, wrong=not finding[-1] >= level) for finding in found),
    )


Compared = tuple[str, str, float]  # test, what was found, p


def _compare(probe: Probe, theta_deg: float, n: int, seed: int) -> Iterator[Compared]:
    """All comparisons at one inclination."""
    theta = math.radians(theta_deg)
    wo = np.array([math.sin(theta), math.cos(theta), 0.0])
    wi, h, lobe, weight, pdf = probe.sample(wo, n, seed)
    reference = import_module(model_of(probe.fibre).reference)
    albedo = np.asarray(reference.albedo(probe.fibre, theta, probe.material.profiles))
    yield _mean("mean weight over the albedo", weight, albedo)
    drawn = np.flatnonzero(lobe < len(probe.lobes))
    yield from _one_by_one(probe, wo, wi[drawn], h[drawn], lobe[drawn], weight[drawn], pdf[drawn])
    yield _counts(probe, wo, lobe, h)
    for k, towards in enumerate(wi[drawn[:_TOWARDS]]):
        far_field = bcsdf_values(
            probe.fibre, wo, towards.astype(np.float64), None, probe.material.profiles
        )["value"]
        rows = np.broadcast_to(towards, (int(n * _LIGHT_SHARE), 3))
        values, _ = probe.estimate_far_field(wo, rows, (seed ^ 0x5EED0000) + k)
        yield _mean("mean of light samples over the far field", values, np.asarray(far_field))


def _mean(test: str, values: NDArray[Any], truth: NDArray[Any]) -> Compared:
    """z test of a mean (n, 3): the channel that is furthest off, allowing for all three."""
    values = values.astype(np.float64)
    mean, error = values.mean(axis=0), values.std(axis=0) / math.sqrt(len(values))
    off = np.maximum(np.abs(mean - truth) - _MEAN_ROUNDING * truth, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(off > 0.0, off / error, 0.0)
        ratio = np.where(truth > 0.0, mean / truth, np.where(mean == truth, 1.0, np.inf))
    # A value that is not finite is wrong by more than any chance.
    p = np.where(np.isfinite(z), np.minimum(3.0 * 2.0 * stats.norm.sf(z), 1.0), 0.0)
    worst = int(np.argmin(p))
    return test, f"{ratio[worst]:.4f}", float(p[worst])


def _one_by_one(
    probe: Probe,
    wo: NDArray[Any],
    wi: NDArray[Any],
    h: NDArray[Any],
    lobe: NDArray[Any],
    weight: NDArray[Any],
    pdf: NDArray[Any],
) -> Iterator[Compared]:
    """Density and weight of each sample that has a lobe."""
    outside = float(np.mean(~(np.abs(h) <= 1.0))) if len(h) else 0.0
    yield "samples with h outside of [-1, 1]", f"{outside:.2%}", float(outside == 0.0)
    kept = np.abs(h) <= 1.0
    wi, h, lobe, weight, pdf = (part[kept] for part in (wi, h, lobe, weight, pdf))
    values, densities = probe.evaluate_lobes(wo, wi, h)
    here = (lobe, np.arange(len(lobe)))
    off = ~(np.abs(pdf - densities[here]) <= _DENSITY_ROUNDING * pdf)
    yield _share("samples whose density is not that of joint_densities", off)
    off = ~(
        np.abs(weight * pdf[:, None] - 0.5 * values[here])
        <= _DENSITY_ROUNDING * 0.5 * values[here] + np.finfo(np.float32).tiny
    )
    yield _share("samples whose weight is not value over density", np.any(off, axis=1))


def _share(test: str, off: NDArray[Any]) -> Compared:
    """More samples that are off than lie on edges."""
    share = float(off.mean()) if len(off) else 0.0
    return test, f"{share:.2%}", float(share <= _ON_EDGES)


def _counts(probe: Probe, wo: NDArray[Any], lobe: NDArray[Any], h: NDArray[Any]) -> Compared:
    """Chi-square of counts in cells of lobe and h, and of samples without a lobe."""
    test, n, lobes = "counts of lobe and h", len(h), len(probe.lobes)
    at = (np.arange(_CELLS * _NODES) + 0.5) * (2.0 / (_CELLS * _NODES)) - 1.0
    density = probe.offset_pdf(wo, at).astype(np.float64)
    chances = density.reshape(lobes * _CELLS, _NODES).mean(axis=1) * (2.0 / _CELLS)
    total = float(chances.sum())
    if not total <= 1.0 + _TOTAL_ROUNDING:
        return test, f"joint_densities add up to {total:.4f}, more than 1", 0.0
    cell = np.clip(((h + 1.0) * (0.5 * _CELLS)).astype(int), 0, _CELLS - 1)
    cell = np.where(lobe < lobes, lobe * _CELLS + cell, lobes * _CELLS)
    seen = np.bincount(cell, minlength=lobes * _CELLS + 1).astype(np.float64)
    wanted = n * np.append(chances, max(1.0 - total, 0.0))
    order = np.argsort(wanted)
    few = int(np.searchsorted(np.cumsum(wanted[order]), _LEAST)) + 1
    pooled, kept = order[:few], order[few:]
    if not len(kept):
        return test, "everything is in one cell", 1.0
    seen, wanted = (np.append(part[kept], part[pooled].sum()) for part in (seen, wanted))
    found = stats.chisquare(seen, wanted * (n / wanted.sum()))
    said = f"chi-square {found.statistic:.0f} of {len(seen)} cells"
    worst = int(np.argmax((seen - wanted) ** 2 / wanted))
    if worst < len(kept) and kept[worst] < lobes * _CELLS:
        name, low = probe.lobes[kept[worst] // _CELLS], kept[worst] % _CELLS * 2 / _CELLS - 1
        said += (
            f", {seen[worst]:.0f} of {name} for {wanted[worst]:.0f} "
            f"at h from {low:.2f} to {low + 2 / _CELLS:.2f}"
        )
    return test, said, float(found.pvalue)
