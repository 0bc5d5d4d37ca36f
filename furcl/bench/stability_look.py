"""Points of the stability sweep at which the device alone is looked at: whether anything that
renders call is not finite, or negative. Float64 costs a hundred times as much."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_points import Points
from furcl.bench.stability_row import Row, describe
from furcl.bench.stability_subject import Subject
from furcl.device.choice import Device
from furcl.device.layout import Mode
from furcl.fibre.samplers import BUILT_IN
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]

QUANTITY = "looked at"
POINTS_PER_FIBRE = 10_000
#: Offsets anywhere, within limits, and one alone; of models that have none, anywhere alone.
MODES: tuple[Mode, ...] = ("far", "multiscale", "near")


class Look:
    """Rows of what is not finite or negative: a row a lobe, and one of samples and light samples.

    A row's points count once, whatever of theirs is wrong; the first wrong one is kept.

    Parameters
    ----------
    device : Device
    subject : Subject       the fibre model
    """

    def __init__(self, device: Device, subject: Subject) -> None:
        self.device, self.subject = device, subject
        self.rows: dict[str, Row] = {}

    def add(self, fibre: Any, points: Points, number: int) -> None:
        """Look at one fibre; samplers and modes take turns by its number."""
        sampling = BUILT_IN[number % len(BUILT_IN)]
        modes = MODES if self.subject.model.has_offset else MODES[:1]
        mode = modes[number // len(BUILT_IN) % len(modes)]
        probe = self._probe(fibre, sampling, mode)
        rng = np.random.default_rng(number)
        within = {
            "far": None, "near": np.stack([points.h, points.h], 1),
            "multiscale": _limits(points.h, rng),
        }[mode]  # fmt: skip
        value, pdf = probe.evaluate_lobes(points.wo, points.wi, points.h, within)
        energy = probe.attenuation(points.h, points.theta)
        for p, lobe in enumerate(probe.lobes):
            self._count(lobe, probe, points, [energy[p], value[p], pdf[p, :, None]])
        seed = int(rng.integers(1 << 32))
        wi, h, _, weight, density = probe.sample(points.wo, seed=seed, within=within)
        # Of directions and offsets only what is not finite counts: their signs are free.
        self._count("sample", probe, points, [wi**2, h[:, None] ** 2, weight, density[:, None]])
        light = probe.estimate_far_field(points.wo, points.wi, seed, within)
        self._count("light sample", probe, points, [light[0], light[1][:, None]])

    def _probe(self, fibre: Any, sampling: str, mode: Mode) -> Probe:
        """One build for all fibres."""
        features = self.subject.model.features(fibre, residual=True).everything_on()
        return Probe(
            fibre, sampling, self.device, channels=3, features=features,
            profiles=self.subject.prepared(features), light_sampling=True, mode=mode,
        )  # fmt: skip

    def _count(self, name: str, probe: Probe, points: Points, parts: list[Array]) -> None:
        values = np.concatenate(parts, axis=1)
        row = self.rows.setdefault(name, Row(QUANTITY, name))
        row.count(values)
        if not row.worst and (row.nan or row.inf or row.negative):
            wrong = ~(np.isfinite(values) & (values >= 0.0)).all(axis=1)
            row.worst = describe(probe.fibre, points, int(np.argmax(wrong)))
            row.worst["sampling"] = probe.sampler.name


def _limits(h: Array, rng: np.random.Generator) -> Array:
    """(n, 2) limits around offsets: one offset, narrow ones, wide ones, all of the width."""
    width = rng.choice([0.0, 1e-6, 1e-3, 0.3, 4.0], len(h))
    share = rng.random(len(h))
    low = np.maximum(h - share * width, -1.0)
    return np.stack([low, np.minimum(h + (1.0 - share) * width, 1.0)], axis=1)
