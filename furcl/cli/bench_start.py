"""`furcl bench start`."""

from __future__ import annotations

from typing import Annotated

import typer

from furcl.cli.options import SIZE, DeviceName, Folder, Overrides, SceneName


def start(
    scene: SceneName,
    out: Folder,
    device: DeviceName = None,
    size: Annotated[str, SIZE] = "512x512",
    runs: Annotated[int, typer.Option(help="Runs with full caches.")] = 5,
    overrides: Overrides = None,
) -> None:
    """Time `furcl render` to its first samples, with empty and with full caches."""
    from furcl.bench import start as bench

    results = bench.run(
        scene,
        out,
        device=device,
        size=size,
        warm_runs=runs,
        overrides=overrides or (),
    )
    cold, warm = results["cold"], results["warm"]
    parts = ", ".join(f"{name} {seconds:.2f}" for name, seconds in cold["parts"].items())
    print(f"first samples, caches empty: {cold['first_samples']:.2f} s ({parts})")
    print(
        f"first samples, caches full: {results['warm_median']:.2f} s, the median of {len(warm)} "
        f"({min(r['first_samples'] for r in warm):.2f} to "
        f"{max(r['first_samples'] for r in warm):.2f}); picture written after "
        f"{min(r['end'] for r in warm):.2f} s"
    )
    print(f"import furcl: {results['import_seconds']:.3f} s")
    print(
        f"largest variant of the kernels: {results['compile_everything_seconds']:.2f} s to compile"
    )
