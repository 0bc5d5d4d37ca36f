"""`furcl bench stability`: the scattering function at the ends of all ranges, and stiff renders."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from furcl.bench.record import circumstances, write_json
from furcl.bench.stability_conditioning import (
    attenuation_conditioning,
    evaluate_conditioning,
    pdf_conditioning,
    reference_attenuation,
    reference_evaluate,
    reference_pdf,
)
from furcl.bench.stability_double_cylinder import SUBJECT as DOUBLE_CYLINDER
from furcl.bench.stability_points import Points
from furcl.bench.stability_renders import settle
from furcl.bench.stability_row import Row, replay_command
from furcl.bench.stability_steps import Found, Step, Sweep, in_order, take
from furcl.bench.stability_subject import Subject
from furcl.bench.stability_total import Total
from furcl.bench.workers import workers_of
from furcl.device.choice import Device, open_device
from furcl.distributed.tasks import Shared

if TYPE_CHECKING:
    from distributed import Client

SCHEMA = "furcl-stability-1"

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
    client: Client | str | None = None,
) -> dict[str, Any]:
    """Compare the device with float64 over the grid and `n_points` random points.

    Parameters
    ----------
    out                 folder for results.json
    device : str, Device or None    as for `furcl.render`; with `client` on each worker, and no
                        Device
    quick : bool        fewer widths, scenes and points: what the tests run as well
    n_points : int      random points; default 10^7, quick 10^5
    n_compared : int    compare only as many of them with float64, and look at the others for what
                        is not finite or negative; default all
    renders : bool      also render scenes/extreme
    subject : Subject   the fibre model; with `client` one that workers can import
    client : Client, text or None   of a Dask cluster whose workers share the sweep, fibre by fibre,
                        or the address of its scheduler. What is found is as with one device

    Returns
    -------
    dict    `rows`: one for each quantity and lobe (furcl.bench.stability_row.Row, with the
            command that replays its worst point); `parameters`: largest excess over the edges of
            each parameter; `weights`: the largest by region (stability_weights.Region);
            `renders`

    Raises
    ------
    DeviceError     no device; with `client` also as `furcl.distributed.render`, and for workers
                    whose devices or drivers differ
    """
    n_points = n_points or (100_000 if quick else 10_000_000)
    n_compared = n_points if n_compared is None else min(n_compared, n_points)
    sweep = Sweep.of(subject, quick, n_compared, n_points - n_compared, renders)
    total = Total()
    with _taken(sweep, seed, device, client) as (where, taken):
        for step, found in taken:
            total.add(step, found)
            if progress:
                progress(step.part, step.number + 1, step.n)
    settle(total.renders)
    results = {
        "schema": SCHEMA,
        "model": subject.model.name,
        **where,
        "quick": quick,
        "seed": seed,
        "random_points": sweep.n_compared + sweep.n_looked_at,
        "compared_points": sweep.n_compared,
        "rows": [_plain(row) for row in total.rows.values()],
        "parameters": total.parameters,
        "weights": [dataclasses.asdict(region) for region in total.regions],
        "renders": total.renders,
    }
    results["passed"] = passed(results)
    write_json(results, Path(out) / "results.json")
    return results


@contextmanager
def _taken(
    sweep: Sweep, seed: int, device: str | Device | None, client: Client | str | None
) -> Iterator[tuple[dict[str, Any], Iterator[tuple[Step, Found]]]]:
    """Where a sweep runs, as JSON values, and its steps in their order with what they found."""
    if client is None:
        opened = device if isinstance(device, Device) else open_device(device)
        yield circumstances(opened), ((s, take(opened, sweep, s)) for s in sweep.steps(seed))
        return
    with workers_of(client, device) as (workers, where):
        steps = sweep.steps_apart(seed)
        coming = Shared(workers, sweep).results(
            take, steps, lambda step: f"{step.part}, {step.number + 1} of {step.n}", twice=True
        )
        with closing(coming):
            yield {**where, "workers": workers.number()}, in_order(coming)


UNBOUNDED = ("evaluate", "pdf", "bin ratio")
"""Quantities compared with float64 point by point, without a bar: of 10^7 points at the ends of all
ranges some differ by more than the allowance for conditioning (docs/numerics.md)."""


def passed(results: dict[str, Any]) -> bool:
    """Whether every bar holds: nothing that is not finite or negative; attenuation, energy,
    integrals and weights within what is allowed; renders that agree."""
    good = all(
        row["nan"] == row["inf"] == row["negative"] == 0
        and (row["excess"] <= 1.0 or row["quantity"] in UNBOUNDED)
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


def _plain(row: Row) -> dict[str, Any]:
    values = dataclasses.asdict(row)
    return {**values, "replay": replay_command(row.worst)}
