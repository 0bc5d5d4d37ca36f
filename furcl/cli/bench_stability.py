"""`furcl bench stability` and `furcl bench replay`."""

from __future__ import annotations

import json
import logging
import time
from typing import Annotated

import typer

from furcl.cli.options import QUICK, SEED, Dask, DeviceName, Folder

log = logging.getLogger(__name__)


def stability(
    output: Folder,
    quick: Annotated[bool, QUICK] = False,
    points: Annotated[
        int | None, typer.Option(help="Random points; 10^7, with --quick 10^5.")
    ] = None,
    compared: Annotated[
        int | None,
        typer.Option(help="Compare so many of them with float64, look at the others; all."),
    ] = None,
    renders: Annotated[bool, typer.Option(help="Also render the scenes of scenes/extreme.")] = True,
    model: Annotated[
        str, typer.Option(help="Fibre model; stiff scenes are of double-cylinder alone.")
    ] = "double-cylinder",
    seed: Annotated[int, SEED] = 1,
    device: DeviceName = None,
    dask: Dask = None,
) -> None:
    """Compare the device with float64 at the ends of all ranges, and render stiff scenes."""
    from furcl.bench import stability as bench
    from furcl.bench.stability_subjects import find
    from furcl.report.stability import write_report

    results = bench.run(
        output, device=device, quick=quick, n_points=points, n_compared=compared, seed=seed,
        progress=_LogLines(), renders=renders and model == "double-cylinder", subject=find(model),
        client=dask,
    )  # fmt: skip
    print_stability(results)
    log.info("wrote %s and results.json", write_report(output))
    if not results["passed"]:
        raise typer.Exit(1)


class _LogLines:
    """A line every ten seconds: the part that is under way and how far it is."""

    def __init__(self) -> None:
        self.last = time.monotonic()

    def __call__(self, part: str, done: int, total: int) -> None:
        if time.monotonic() - self.last >= 10.0 or done == total:
            self.last = time.monotonic()
            log.info("%s: %d of %d", part, done, total)


def print_stability(results: dict) -> None:
    """The rows as tables."""
    from furcl.cli.bench import print_table

    names = ["quantity", "lobe", "points", "nan", "inf", "negative"]
    numbers = ["max_absolute", "max_relative", "conditioning", "excess"]
    print_table(
        [*names, "abs error", "rel error", "conditioning", "error / allowed"],
        [[row[name] for name in names + numbers] for row in results["rows"]],
    )
    if results["renders"]:
        print_table(
            ["scene", "largest", "nonfinite", "energy", "p", "bias seen", "agrees"],
            [
                [
                    r["scene"],
                    r["largest"],
                    r["nonfinite"],
                    r["energy"],
                    r["p"],
                    r["detects"],
                    r["agrees"],
                ]
                for r in results["renders"]
            ],
        )


def replay(
    point: Annotated[str, typer.Argument(help="The JSON object of a row of `bench stability`.")],
    device: DeviceName = None,
) -> None:
    """Print device and float64 values of every lobe at one point."""
    from furcl.bench.stability import replay as run
    from furcl.bench.stability_subjects import find
    from furcl.cli.bench import print_table

    values = json.loads(point)
    rows = run(values, device, find(values.get("model", "double-cylinder")))
    print_table(["quantity", "lobe", "device", "float64", "one unit in the last place"], rows)
