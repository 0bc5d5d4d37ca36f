"""`furcl bench stability`: the scattering function at the ends of all ranges, and stiff renders."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.record import circumstances, write_json
from furcl.bench.stability_compare import BARS, Comparison
from furcl.bench.stability_conditioning import (
    attenuation_conditioning,
    evaluate_conditioning,
    pdf_conditioning,
    reference_attenuation,
    reference_evaluate,
    reference_pdf,
)
from furcl.bench.stability_double_cylinder import SUBJECT as DOUBLE_CYLINDER
from furcl.bench.stability_integrals import factors, integrals
from furcl.bench.stability_look import POINTS_PER_FIBRE as LOOKED_AT_PER_FIBRE
from furcl.bench.stability_look import Look
from furcl.bench.stability_medulla import medulla_rows
from furcl.bench.stability_points import Points
from furcl.bench.stability_reference import reference_rows
from furcl.bench.stability_renders import render_rows
from furcl.bench.stability_row import Row, replay_command
from furcl.bench.stability_subject import Subject
from furcl.device.choice import Device, open_device

SCHEMA = "furcl-stability-1"
POINTS_PER_FIBRE = 2000

WIDTHS = (1e-3, 1.5e-3, 3e-3, 1e-2, 0.03, 0.1, 0.27, 0.39, 0.41, 0.7, 1.0, 1.1, 1.49, 1.51, 2.5)
"""Widths [rad] at which M and D are integrated: the range that a `Fibre` allows, and both sides of
where a formula changes."""

#: Called with the part that is under way, and its steps done and in all.
Progress = Callable[[str, int, int], None]


def run(
    out: str | os.PathLike[str],
    *,
    device: str | Device | None = None,
    quick: bool = False,
    n_points: int | None = None,
    n_compared: int | None = None,
    renders: bool = True,
    seed: int = 1,
    progress: Progress | None = None,
    subject: Subject = DOUBLE_CYLINDER,
) -> dict[str, Any]:
    """Compare the device with float64 over the grid and `n_points` random points.

    Parameters
    ----------
    out                 folder for results.json
    quick : bool        fewer widths, scenes and points: what the tests run as well
    n_points : int      random points; default 10^7, quick 10^5
    n_compared : int    compare only as many of them with float64, and look at the others for what
                        is not finite or negative; default all
    renders : bool      also render scenes/extreme
    subject : Subject   the fibre model

    Returns
    -------
    dict    `rows`: one for each quantity and lobe (furcl.bench.stability_compare.Row, with the
            command that replays its worst point); `parameters`: largest excess over the edges of
            each parameter; `weights`: the largest by region (stability_weights.Region);
            `renders`
    """
    opened = device if isinstance(device, Device) else open_device(device)
    n_points = n_points or (100_000 if quick else 10_000_000)
    say = progress or (lambda *_: None)
    rng = np.random.default_rng(seed)
    total = Comparison(opened, subject)
    parameters = _grid(total, rng, 200 if quick else POINTS_PER_FIBRE, quick, say)
    n_compared = n_points if n_compared is None else min(n_compared, n_points)
    n_fibres = max(1, n_compared // POINTS_PER_FIBRE)
    for i in range(n_fibres):
        fibre = subject.random(rng)
        # Compiling for every other fibre anew would take most of a quick run.
        specialised = i % 8 == 0 if quick else True
        total.add(fibre, subject.points(fibre, rng, POINTS_PER_FIBRE), i, specialised)
        say("random points", i + 1, n_fibres)
    look = Look(opened, subject)
    n_looked_at = -(-(n_points - n_compared) // LOOKED_AT_PER_FIBRE)
    for i in range(n_looked_at):
        fibre = subject.random(rng)
        look.add(fibre, subject.points(fibre, rng, LOOKED_AT_PER_FIBRE), i)
        say("points looked at", i + 1, n_looked_at)
    own_rows = OWN_ROWS.get(subject.model.name, lambda *_: [])
    rows = [*total.rows.values(), *look.rows.values(), *own_rows(opened, quick)]
    say("integrals", 1, 1)
    results = {
        "schema": SCHEMA,
        "model": subject.model.name,
        **circumstances(opened),
        "quick": quick,
        "seed": seed,
        "random_points": n_fibres * POINTS_PER_FIBRE + n_looked_at * LOOKED_AT_PER_FIBRE,
        "compared_points": n_fibres * POINTS_PER_FIBRE,
        "rows": [_plain(row) for row in rows],
        "parameters": parameters,
        "weights": [dataclasses.asdict(region) for region in total.regions],
        "renders": render_rows(opened, quick, say) if renders else [],
    }
    results["passed"] = passed(results)
    write_json(results, Path(out) / "results.json")
    return results


def _double_cylinder_rows(device: Device, quick: bool) -> list[Row]:
    """Integrals of its lobes, its simulated profiles, and its reference against 60 digits."""
    betas = (1e-3, 0.41, 2.5) if quick else (1e-3, 3e-3, 0.03, 0.39, 0.41, 1.49, 1.51, 2.5)
    degrees = (0.0, 60.0) if quick else (0.0, 60.0, 85.0, 89.5)
    return [
        *factors(device, WIDTHS, [math.radians(d) for d in (0.0, 30.0, 60.0, 85.0, 89.5, 90.0)]),
        *integrals(device, betas, [math.radians(d) for d in degrees]),
        *medulla_rows(device, quick),
        *reference_rows(),
    ]


OWN_ROWS = {"double-cylinder": _double_cylinder_rows}
"""What else is swept of a model."""

COMPARED = ("evaluate", "pdf", "bin ratio")
"""Quantities compared with float64 point by point, without a bar: of 10^7 points at the ends of all
ranges some differ by more than the allowance for conditioning (docs/numerics.md)."""


def passed(results: dict[str, Any]) -> bool:
    """Whether every bar holds: nothing that is not finite or negative; attenuation, energy,
    integrals and weights within what is allowed; renders that agree."""
    good = all(
        row["nan"] == row["inf"] == row["negative"] == 0
        and (row["excess"] <= 1.0 or row["quantity"] in COMPARED)
        for row in results["rows"]
    )
    return good and all(r["agrees"] and r["nonfinite"] == 0 for r in results["renders"])


def replay(
    point: dict[str, Any],
    device: str | Device | None = None,
    subject: Subject = DOUBLE_CYLINDER,
) -> list[list[Any]]:
    """Device and float64 values at a point of a row, as quantity, lobe, device, float64, and what
    one unit in the last place of the inputs changes; of the point's channel, or the first."""
    fibre = subject.parameters(**point["fibre"])
    probe = subject.probe(fibre, device, point.get("sampling", "full-cdf"))
    at = Points(*(np.array([point[name]], np.float64) for name in ("sin_cos", "h", "wo", "wi")))
    theta = at.theta
    value, pdf = probe.evaluate_lobes(at.wo, at.wi, at.h)
    densities = np.stack(
        [reference_pdf(probe, at.wo, at.wi, at.h, p) for p in range(len(probe.lobes))]
    )
    quantities = (
        ("attenuation", probe.attenuation(at.h, theta), reference_attenuation(probe, at.h, theta),
         attenuation_conditioning),
        ("evaluate", value,
         reference_evaluate(probe, at.wo, at.wi, at.h), evaluate_conditioning),
        ("pdf", pdf[..., None], densities, pdf_conditioning),
    )  # fmt: skip
    rows = []
    for quantity, got, exact, conditioning in quantities:
        for p, lobe in enumerate(probe.lobes):
            found = (
                x[0, min(point.get("channel", 0), x.shape[1] - 1)]
                for x in (got[p], exact[p], conditioning(probe, subject.neighbours, at, [0], p))
            )
            rows.append([quantity, lobe, *(float(x) for x in found)])
    if "numbers" in point:
        _, _, lobe, weight, _ = probe.sample(at.wo, numbers=[point["numbers"]])
        rows.append(["sample weight", probe.lobes[int(lobe[0])], float(weight.mean()), "", ""])
    return rows


def _grid(
    total: Comparison, rng: np.random.Generator, n: int, quick: bool, say: Progress
) -> list[dict[str, Any]]:
    """Add the fibres of the grid; errors of each by the parameter that is at an edge."""
    found = []
    subject = total.subject
    fibres = list(subject.grid())
    # The quick grid: every third fibre; all edges are also among the random ones.
    for i, (name, value, fibre) in enumerate(fibres[::3] if quick else fibres):
        part = Comparison(total.device, subject)
        part.add(fibre, subject.points(fibre, rng, n), i, specialised=not quick)
        found.append(
            {
                "parameter": name,
                "value": value,
                "excess": {
                    quantity: max(r.excess for r in part.rows.values() if r.quantity == quantity)
                    for quantity in BARS
                },
                # Black fibres are never sampled.
                "weight": max(
                    (r.max_absolute for r in part.rows.values() if r.quantity == "sample weight"),
                    default=0.0,
                ),
            }
        )
        total.merge(part)
        say("grid", i + 1, len(fibres))
    return found


def _plain(row: Row) -> dict[str, Any]:
    values = dataclasses.asdict(row)
    return {**values, "replay": replay_command(row.worst)}
