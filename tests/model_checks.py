"""What the fibre of any model has to pass; the tests of a model name the fibre and what is allowed.

Each check has a mutant of its own that must fail.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from direction_statistics import chi_square_p
from offset_cells import N_CELLS, cell, integrals, wo_at
from scipy import stats

from furcl.bench.convergence_statistics import ratio_interval, slope
from furcl.bench.stability_row import Row
from furcl.device.choice import Device
from furcl.rendering.probe import Probe
from furcl.rendering.renderer import Renderer
from furcl.scene.tables import Scene

SAMPLERS = ("uniform-h", "attenuation-cdf", "full-cdf")
N_SAMPLES = 400_000
CONFIDENCE = 0.999
"""Of each interval that a check looks into."""


def directions(rng: np.random.Generator, n: int) -> np.ndarray:
    """Unit vectors (n, 3) in the fibre's frame, as float32 has them; half of them near the poles or
    the normal plane."""
    s = np.concatenate([rng.uniform(-1, 1, n // 2), np.sin(rng.uniform(-1, 1, n - n // 2) * 1.57)])
    phi = rng.uniform(-np.pi, np.pi, n)
    c = np.sqrt((1 - s) * (1 + s))
    w = np.stack([s, c * np.cos(phi), c * np.sin(phi)], 1).astype(np.float32).astype(np.float64)
    return w / np.linalg.norm(w, axis=1, keepdims=True)


def check_reference(reference: ModuleType) -> None:
    """Its functions have the arguments that docs/oracle.md lists."""
    page = Path(__file__).parents[1] / "docs" / "oracle.md"
    section = page.read_text().split("## Another model")[1]
    listed = re.findall(r"^    (\w+)\((.*)\)$", section, re.MULTILINE)
    assert len(listed) == 7
    for function, arguments in listed:
        found = inspect.signature(getattr(reference, function))
        plain = [p.replace(annotation=p.empty) for p in found.parameters.values()]
        assert str(inspect.Signature(plain)) == f"({arguments})"


def check_same_light_in_the_same_directions(
    probe: Probe, reference: Any, theta: float, seed: int, level: float
) -> None:
    """Two-sample z tests of device and float64 samples: the light in each lobe, its directions and
    their side. Float64 samples of wi or of h turned round must not pass."""
    n = 200_000
    wi, h, lobe, weight, _ = probe.sample(wo_at(theta), n=n, seed=seed % 2**32)
    mine = _moments(*(x.astype(np.float64) for x in (wi, h, lobe, weight)))
    drawn = reference.sample(
        probe.fibre, wo_at(theta), n, probe.material.profiles,
        sampling=probe.sampler.name, rng=seed,
    )  # fmt: skip
    limit = stats.norm.isf(level / 2)
    assert _largest_z(mine, _moments(drawn.wi, drawn.h, drawn.lobe, drawn.weight)) < limit
    for turned in ((-drawn.wi, drawn.h), (drawn.wi, -drawn.h)):
        assert _largest_z(mine, _moments(*turned, drawn.lobe, drawn.weight)) > 2 * limit


def _moments(wi, h, lobe, weight) -> np.ndarray:
    """(n, 25) of weight times functions of what was drawn, whose means no sampler changes: 1, s,
    s^2 and the sides of phi, in each of five lobes."""
    phi = np.arctan2(wi[:, 2], wi[:, 1])
    functions = (np.ones(len(h)), wi[:, 0], wi[:, 0] ** 2, np.cos(phi), np.sign(h) * np.sin(phi))
    scalar = weight.mean(1)
    return np.stack([scalar * f * (lobe == p) for p in range(5) for f in functions], 1)


def _largest_z(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of the means over its standard error, of moments drawn often enough."""
    error = np.sqrt(a.var(0) / len(a) + b.var(0) / len(b))
    often = (a != 0).sum(0) > 500
    return float(np.abs((a.mean(0) - b.mean(0)) / np.maximum(error, 1e-12))[often].max())


def check_samples_follow_their_density(
    probe: Probe,
    theta: float,
    seed: int,
    level: float,
    resolved: Callable[[int], np.ndarray] | None = None,
) -> None:
    """Chi-square of (lobe, h, phi, s) against Probe.pdf; a density 2 % too high must be seen in
    every lobe that is chosen for a fifth of the samples.

    `resolved(lobe)` says which cells midpoints can integrate; the others count with what is
    outside the lobe.
    """
    n = N_SAMPLES
    wi, h, lobe, _, _ = probe.sample(wo_at(theta), n=n, seed=seed % 2**32)
    cells = cell(h, np.arctan2(wi[:, 2], wi[:, 1]), wi[:, 0])
    expected = n * integrals(lambda w, offset: probe.evaluate_lobes(wo_at(theta), w, offset)[1])
    for p, name in enumerate(probe.lobes):
        inside = np.full(N_CELLS, True) if resolved is None else resolved(p)
        counts = np.bincount(cells[lobe == p], minlength=N_CELLS)[inside]
        observed = np.append(counts, n - counts.sum())
        predicted = expected[p][inside]
        # A lobe with few samples in every cell says nothing but how often it is chosen.
        if predicted.sum() < 100 or predicted.max() < 5.0:
            assert abs(counts.sum() - predicted.sum()) < 10 + 5 * np.sqrt(predicted.sum())
            continue
        assert _p(observed, predicted) > level, name
        if predicted.sum() > 0.2 * n:
            assert _p(observed, 1.02 * predicted) < level, f"a density 2 % too high: {name}"


def _p(observed: np.ndarray, predicted: np.ndarray) -> float:
    """p-value of the counts in cells, and of all the rest of the samples."""
    return chi_square_p(observed, np.append(predicted, max(N_SAMPLES - predicted.sum(), 0.0)))


def check_weights_are_value_over_density(
    probe: Probe, wo: np.ndarray, seed: int, binned: Collection[str] = ()
) -> None:
    """Half the value over the density of what `sample` returns is the weight that it returns.

    Directions of `binned` lobes, found again from wi, may lie in the next bin of a profile.
    """
    wi, h, lobe, weight, pdf = probe.sample(wo, seed=seed % 2**32)
    assert np.all(np.isfinite(weight))
    assert np.all(weight >= 0)
    assert np.all(pdf > 0)
    np.testing.assert_allclose(np.linalg.norm(wi, axis=1), 1, atol=1e-6)
    for p, name in enumerate(probe.lobes):
        chosen = lobe == p
        if not chosen.any():
            continue
        value = 0.5 * probe.evaluate(wo[chosen], wi[chosen], h[chosen], lobe=p)
        density = probe.pdf(wo[chosen], wi[chosen], h[chosen], lobe=p)
        error = np.abs(density / pdf[chosen] - 1)
        same = error < 1e-4 if name in binned else np.full(len(density), True)
        assert same.mean() > 0.995, name
        # Angles are known to about 1e-6 rad, and narrow lobes are 0.05 rad wide.
        assert np.mean(error < 1e-3) > 0.995, name
        ratio = value[same] / density[same, None]
        np.testing.assert_allclose(ratio, weight[chosen][same], rtol=1e-4, atol=1e-7)


def check_mean_weight(probe: Probe, theta: float, albedo: np.ndarray) -> None:
    """Within 4 standard errors of the directional albedo (3,), which 2 % more is not."""
    weight = probe.sample(wo_at(theta), n=100_000, seed=9)[3].astype(np.float64)
    error = 4 * weight.std(axis=0) / np.sqrt(len(weight)) + 2e-5
    assert np.all(np.abs(weight.mean(axis=0) - albedo) < error)
    assert np.all(np.abs(weight.mean(axis=0) - 1.02 * albedo) > error)


def check_picture_shows_albedo(
    scene: Scene, device: Device, albedo: Callable[[Any], np.ndarray]
) -> None:
    """A fibre that fills the picture, in white light: the mean is its directional albedo within 3
    standard errors, which 5 % more is not. `albedo` is given what the model prepared."""
    renderer = Renderer(scene, device)
    renderer.advance(scene.render.spp)
    image = renderer.image()
    mean = image.rgb.astype(np.float64).mean(axis=(0, 1))
    assert image.variance is not None
    n = image.width * image.height
    error = np.sqrt(image.variance.astype(np.float64).sum(axis=(0, 1))) / n
    expected = albedo(renderer.material.profiles)
    # Some samplers leave so little noise that float32 counts; others up to 0.6 % of the value.
    assert np.all(np.abs(mean - expected) < 3 * error + 3e-5)
    assert np.all(np.abs(mean - 1.05 * expected) > 3 * error + 3e-5)


def furnace_z(scene: Scene, device: Device) -> float:
    """Difference of a picture's mean from white, in standard errors."""
    renderer = Renderer(scene, device)
    renderer.advance(scene.render.spp)
    image = renderer.image()
    mean = image.rgb[..., 0].astype(np.float64)
    assert image.variance is not None
    assert image.stats["hits_per_path"] > 0.2  # most of the picture is background
    error = np.sqrt(image.variance[..., 0].astype(np.float64).sum()) / mean.size
    return float((mean.mean() - 1.0) / error)


def estimates(results: dict[str, Any], sampling: str) -> tuple[np.ndarray, np.ndarray]:
    """RMSE and MSE over variance, (runs, spp), of what furcl.bench.convergence.run returns."""
    rows = [row for row in results["renders"] if row["variant"] == sampling]
    spp = sorted({row["spp"] for row in rows})
    runs = sorted({row["run"] for row in rows})
    at = {(row["run"], row["spp"]): row for row in rows}
    table = [[at[run, n] for n in spp] for run in runs]
    rmse = [[row["rmse"] for row in line] for line in table]
    ratio = [[row["mse"] / row["variance"] for row in line] for line in table]
    return np.array(rmse), np.array(ratio)


def check_error_falls_as_monte_carlo_does(results: dict[str, Any], sampling: str) -> None:
    """Slope -1/2, and the error is that which the variance image says: no bias."""
    rmse, over_variance = estimates(results, sampling)
    found = slope(sorted({row["spp"] for row in results["renders"]}), rmse, CONFIDENCE)
    assert found.contains(-0.5), found
    assert found.high - found.low < 0.25
    for column in over_variance.T:
        assert ratio_interval(column, CONFIDENCE).contains(1.0), column


def check_sweep(rows: dict[tuple[str, str], Row]) -> None:
    """What furcl.bench.stability_compare found for a model's fibres at the ends of their ranges.

    Attenuation within 1e-5 or 1e-7, evaluate and densities within 1e-4 or 1e-6, or what one unit in
    the last place of the inputs does to the float64 reference, eight times; and mostly the bars
    alone. Energy within a thousandth of what the model allows, weights as `Subject` says.
    """
    quantities = {quantity for quantity, _ in rows}
    assert quantities >= {"attenuation", "evaluate", "pdf", "sample weight", "value over pdf"}
    for (quantity, _), row in rows.items():
        assert (row.nan, row.inf, row.negative) == (0, 0, 0), row
        assert row.excess <= 1.0, row
        if quantity in ("attenuation", "evaluate"):
            assert row.within_bars > 0.95 * row.points, row
    assert ("energy", "all") in rows
