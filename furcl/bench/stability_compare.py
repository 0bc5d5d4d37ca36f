"""Device against float64 reference at the points of `furcl.bench.stability_points`, one fibre at a
time: what is not finite, what is negative, the largest errors and where they are."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_conditioning import (
    attenuation_conditioning,
    evaluate_conditioning,
    nearby,
    pdf_conditioning,
    reference_attenuation,
    reference_evaluate,
    reference_pdf,
    rescaled,
)
from furcl.bench.stability_points import LAST, Points
from furcl.bench.stability_row import CONDITION_FACTOR, Row, describe
from furcl.bench.stability_subject import Subject
from furcl.bench.stability_weights import (
    BIN_RATIO,
    Rows,
    inside,
    largest_weight,
    no_regions,
)
from furcl.device.choice import Device
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]

BARS = {"attenuation": (1e-5, 1e-7), "evaluate": (1e-4, 1e-6), "pdf": (1e-4, 1e-6)}
"""Relative and absolute error that count as none, by quantity."""

ON_AXIS = 1e-12
"""Sines of the angle to the axis below which a direction's azimuth is not compared."""

HARDEST = 64
"""Points of a batch, those with the largest errors, for which that effect is computed."""


class Comparison:
    """Collects rows over many fibres.

    Parameters
    ----------
    device : Device
    subject : Subject       the fibre model
    """

    def __init__(self, device: Device, subject: Subject) -> None:
        self.device, self.subject = device, subject
        self.rows: dict[tuple[str, str], Row] = {}
        self.regions = no_regions()

    def row(self, quantity: str, lobe: str) -> Row:
        """The row of a quantity and a lobe."""
        return self.rows.setdefault((quantity, lobe), Row(quantity, lobe))

    def add(self, fibre: Any, points: Points, seed: int, specialised: bool = True) -> None:
        """Compare one fibre at some points."""
        probe = self.subject.probe(fibre, self.device, specialised=specialised)
        self._attenuation(probe, points)
        self._evaluate(probe, points)
        self._sample(probe, points, seed)
        # The other samplers share its tables and lobes: a sixteenth of the fibres will do.
        for sampling in ("uniform-h", "attenuation-cdf") if seed % 16 == 0 else ():
            other = self.subject.probe(fibre, self.device, sampling, specialised=False)
            self._sample(other, points, seed)

    def _attenuation(self, probe: Probe, points: Points) -> None:
        theta = points.theta
        got = probe.attenuation(points.h, theta).astype(np.float64)
        reference = reference_attenuation(probe, points.h, theta)
        for p, lobe in enumerate(probe.lobes):
            row = self.row("attenuation", lobe)
            row.count(got[p])
            self._errors(row, probe, points, got[p], reference[p], attenuation_conditioning, p)
        self._bin_ratios(probe, points, theta, reference.mean(-1))
        total = self.row("energy", "all")
        total.count(got.sum(0))
        most = got.sum(0).max(-1)
        at = int(np.argmax(most))
        if most[at] > total.value:
            total.value, total.reference = float(most[at]), float(reference.sum(0)[at].max())
            allowed = self.subject.most_energy(probe.fibre)
            total.excess = max(most[at] / allowed - 1.0, 0.0) / 1e-3
            total.worst = describe(probe.fibre, points, at)

    def _bin_ratios(self, probe: Probe, points: Points, theta: Array, reference: Array) -> None:
        """Weights at the points, from the float64 attenuation and the tables, against their bar.

        Peaks narrower than a millionth of h count with what is beside them.
        """
        tables = probe.material.tables
        if tables is None:
            return
        beside = [
            reference_attenuation(probe, rescaled(points.h, way), theta).mean(-1)
            for way in (-4.0, 4.0)
        ]
        reference = np.minimum(reference, np.maximum(*beside))
        rows = Rows(tables, points.sin_cos[:, 1])
        weight = rows.weight(reference, points.h)
        allowed = np.maximum(BIN_RATIO * rows.energy, 1e-30)
        for region in self.regions:
            here = inside(region, self.subject.index(probe.fibre), points.sin_cos[:, 1])
            ratio = BIN_RATIO * weight[:, here] / allowed[here]
            region.bin_ratio = max(region.bin_ratio, float(ratio.max(initial=0.0)))
        for p, lobe in enumerate(probe.lobes):
            row = self.row("bin ratio", lobe)
            row.count(weight[p, :, None])
            self._largest(row, probe, points, weight[p], allowed)

    def _largest(self, row: Row, probe: Probe, points: Points, weight, allowed, at=None) -> bool:
        """Note the largest weight over what is allowed; whether it is the row's largest so far."""
        row.max_absolute = max(row.max_absolute, float(weight.max()))
        ratio = weight / allowed
        i = int(np.argmax(ratio))
        if row.worst and ratio[i] <= row.excess:
            return False
        row.excess, row.value = float(ratio[i]), float(weight[i])
        row.reference = float(allowed[i])
        row.worst = describe(probe.fibre, points, i if at is None else int(at[i]))
        return True

    def _evaluate(self, probe: Probe, points: Points) -> None:
        value, pdf = probe.evaluate_lobes(points.wo, points.wi, points.h)
        reference = reference_evaluate(probe, points.wo, points.wi, points.h)
        for p, lobe in enumerate(probe.lobes):
            row = self.row("evaluate", lobe)
            row.count(value[p])
            self._densities(probe, points, pdf[p, :, None].astype(np.float64), p)
            self._errors(
                row, probe, points, value[p].astype(np.float64), reference[p],
                evaluate_conditioning, p,
            )  # fmt: skip

    def _densities(self, probe: Probe, points: Points, pdf: Array, p: int) -> None:
        """Densities (n, 1) of a lobe against float64, where neither direction lies on the axis,
        where it has no azimuth (measured: nearer than 1e-16)."""
        row = self.row("pdf", probe.lobes[p])
        row.count(pdf)
        if probe.material.tables is None:
            return
        reference = reference_pdf(probe, points.wo, points.wi, points.h, p)
        off_axis = [np.hypot(*w[:, 1:].T) > ON_AXIS for w in (points.wo, points.wi)]
        there = np.flatnonzero(np.isfinite(reference[:, 0]) & off_axis[0] & off_axis[1])
        if len(there):
            kept = Points(*(x[there] for x in dataclasses.astuple(points)))
            self._errors(row, probe, kept, pdf[there], reference[there], pdf_conditioning, p)

    def _errors(
        self, row: Row, probe: Probe, points: Points, got, reference, conditioning, p: int
    ) -> None:
        relative_bar, absolute_bar = BARS[row.quantity]
        error = np.abs(got - reference)
        allowed = np.maximum(relative_bar * reference, absolute_bar)
        excess = np.nan_to_num(error / allowed, nan=np.inf).max(-1)
        row.within_bars += int((excess <= 1.0).sum())
        row.max_absolute = max(row.max_absolute, float(np.nanmax(error)))
        large = reference > 100.0 * absolute_bar
        if large.any():
            relative = np.divide(error, reference, out=np.zeros_like(error), where=large)
            row.max_relative = max(row.max_relative, float(relative.max()))
        hardest = np.argsort(-excess)[:HARDEST]
        hardest = hardest[excess[hardest] > 1.0] if excess[hardest[0]] > 1.0 else hardest[:1]
        effect = conditioning(probe, self.subject.neighbours, points, hardest, p)
        allowed = allowed[hardest] + CONDITION_FACTOR * effect
        ratio = np.nan_to_num(error[hardest] / allowed, nan=np.inf)
        at, channel = np.unravel_index(np.argmax(ratio), ratio.shape)
        if ratio[at, channel] > row.excess or not row.worst:
            i = hardest[at]
            row.excess = float(ratio[at, channel])
            row.value = float(got[i, channel])
            row.reference = float(reference[i, channel])
            row.conditioning = float(effect[at, channel])
            row.worst = {**describe(probe.fibre, points, int(i)), "channel": int(channel)}

    def _sample(self, probe: Probe, points: Points, seed: int) -> None:
        n = len(points)
        rng = np.random.default_rng(seed)
        numbers = (rng.integers(0, 1 << 24, (n, 2, 4)) * 2.0**-24).astype(np.float32)
        # Half of the points draw numbers of which a third are the ends of what a generator returns.
        ends = rng.random(numbers.shape) + (np.arange(n) % 2)[:, None, None]
        numbers = np.where(ends < 1 / 6, 0.0, np.where(ends < 1 / 3, LAST, numbers))
        wi, h, lobe, weight, pdf = probe.sample(points.wo, numbers=numbers)
        factors = self.subject.direction_factors(probe)
        cos = np.hypot(points.wo[:, 1], points.wo[:, 2])
        energy = self.subject.most_energy(probe.fibre)
        allowed = largest_weight(probe, factors, cos, energy)
        suffix = "" if probe.sampler.name == "full-cdf" else f" ({probe.sampler.name})"
        for p, name in enumerate(probe.lobes):
            chosen = np.flatnonzero(lobe == p)
            if not len(chosen):
                continue
            row = self.row("sample weight" + suffix, name)
            row.count(np.concatenate([weight, h[:, None] ** 2, pdf[:, None]], 1)[chosen])
            row.nan += int(np.isnan(wi[chosen]).any(-1).sum())
            bad = ~(np.isfinite(weight[chosen]) & (weight[chosen] >= 0.0)).all(-1)
            scalar = np.where(bad, np.inf, weight[chosen].mean(-1))
            if self._largest(row, probe, points, scalar, allowed[p, chosen], chosen):
                at = int(np.argmax(scalar / allowed[p, chosen]))
                row.worst |= {"numbers": numbers[chosen[at]].tolist()}
                row.worst |= {"sampling": probe.sampler.name}
            if not suffix:
                self._regions(probe, points.wo[chosen], scalar)
            drawn = chosen[chosen % 2 == 1]
            self._weights(probe, points, drawn, name, p, (wi, h, weight))

    def _regions(self, probe: Probe, wo: Array, weight: Array) -> None:
        """The largest weights (n,) at directions wo (n, 3), by region."""
        cos = np.hypot(wo[:, 1], wo[:, 2])
        assert probe.material.tables is not None
        ratio = weight / np.maximum(Rows(probe.material.tables, cos).energy, 1e-30)
        for region in self.regions:
            here = inside(region, self.subject.index(probe.fibre), cos)
            region.samples += int(here.sum())
            region.weight = max(region.weight, float(weight[here].max(initial=0.0)))
            region.ratio = max(region.ratio, float(ratio[here].max(initial=0.0)))

    def _weights(self, probe, points: Points, chosen, name: str, p: int, sampled) -> None:
        """0.5 evaluate / pdf of what `sample` returns is its weight."""
        wi, h, weight = (x[chosen].astype(np.float64) for x in sampled)
        relative, there = np.full(len(h), np.inf), np.zeros(len(h), bool)
        # A direction or an offset on the edge of a bin has the value of either side.
        for turned, moved in itertools.product(
            (wi, *nearby(wi)), (h, rescaled(h, -1.0), rescaled(h, 1.0))
        ):
            value, pdf = (
                x[p].astype(np.float64)
                for x in probe.evaluate_lobes(points.wo[chosen], turned, moved)
            )
            # Densities that float32 rounds to nothing have no ratio.
            positive = pdf > 1e-30
            ratio = 0.5 * value / np.where(positive, pdf, 1.0)[:, None]
            error = np.abs(ratio - weight).max(-1) / np.maximum(weight.max(-1), 1e-7)
            relative = np.minimum(relative, np.where(positive, error, np.inf))
            there |= positive
            if (relative[there] <= 1e-4).all():
                break
        row = self.row("value over pdf", name)
        bar = self.subject.weight_bars.get(name, 1e-4)
        row.points += int(there.sum())
        row.within_bars += int((relative[there] <= 1e-4).sum())
        if there.any() and relative[there].max() > row.max_relative:
            at = int(np.argmax(np.where(there, relative, 0.0)))
            row.max_relative = float(relative[at])
            row.excess = row.max_relative / bar
            row.worst = describe(probe.fibre, points, int(chosen[at]))
            row.worst |= {"wi": wi[at].tolist(), "h": float(h[at])}
