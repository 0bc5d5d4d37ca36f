"""Every kernel of a render, built for GPUs that need not be there: registers, stack and spills.

python bench/gpu_check.py [--tools FOLDER] [-o OUT] [--pairs]

`make gpu-check` does it, with the compilers that bench/install_gpu_tools.sh puts into a folder. The
variants are rows of the compile matrix (furcl/bench/variants.py) in which every value of every
field occurs, or with --pairs every pair. Ends with 1 if a bar does not hold; the bars are below.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from gpu_compilers import NVIDIA, TARGETS, Tools, Use

from furcl.bench.record import write_json
from furcl.bench.variants import VALUES, Row, covering, features_of, pairwise, reachable
from furcl.device.source import kernel_text
from furcl.rendering.wavefront import stage_defines, stage_files, stage_programs
from furcl.version import software

#: As furcl.device.launch sees a GPU.
GPU: Any = SimpleNamespace(is_cpu=False)

SPILLS = 0
#: Bytes of a work-item's private memory in a kernel that sends rays through the tree.
TRAVERSAL_STACK = 512
#: Registers of NVIDIA's in `shade` where it evaluates no fibre.
SHADE_REGISTERS = 96

Rows = list[dict[str, Any]]


def rows_of_matrix(pairs: bool) -> list[Row]:
    """Variants, all that are wanted."""
    rows, _ = pairwise(VALUES, reachable)
    return rows if pairs else covering(rows)


def programs(rows: Sequence[Row]) -> Iterator[tuple[int, bool, list[str], str]]:
    """Variant, whether it evaluates fibres (for light samples, or as `all-lobes` weighs), kernels
    and text of all that a GPU compiles."""
    seen = set()
    for number, row in enumerate(rows):
        features = features_of(row)
        files = stage_files(features)
        evaluates = features.light_sampling or row["sampler"] == "all-lobes"
        for stages in stage_programs(features):
            names = list(dict.fromkeys(files[stage] for stage in stages))
            text = kernel_text(names, features, stage_defines(stages[0], GPU))
            if text not in seen:
                seen.add(text)
                yield number, evaluates, stages, text


def check(tools: Tools, rows: Sequence[Row], folder: Path, jobs: int) -> Rows:
    """What each kernel needs at most over all variants: see `most`."""

    def uses(numbered: tuple[int, tuple[int, bool, list[str], str]]) -> Rows:
        i, (variant, evaluates, stages, text) = numbered
        file = folder / f"{i}.cl"
        file.write_text(text)
        found = tools.uses(file)
        for target, kernels in found.items():
            assert set(kernels) == set(stages), (target, set(kernels) ^ set(stages))
        print(f"variant {variant}: {', '.join(stages)}", file=sys.stderr, flush=True)
        for made in folder.glob(f"{i}.*"):
            made.unlink()
        return [
            {"kernel": k, "evaluates": evaluates, "target": t, "variant": variant, **asdict(use)}
            for t, kernels in found.items()
            for k, use in kernels.items()
        ]

    with ThreadPoolExecutor(jobs) as pool:
        return most([use for found in pool.map(uses, enumerate(programs(rows))) for use in found])


def most(uses: Rows) -> Rows:
    """For each kernel, evaluating fibres or not, and target: the number of its variants and the
    most that one needs of each."""
    groups: dict[tuple, Rows] = {}
    for use in uses:
        groups.setdefault((use["kernel"], use["evaluates"], use["target"]), []).append(use)
    keys = Use.__dataclass_fields__
    return [
        {
            "kernel": kernel, "evaluates": evaluates, "target": target, "variants": len(group),
            **{key: max(use[key] for use in group) for key in keys},
        }
        for (kernel, evaluates, target), group in groups.items()
    ]  # fmt: skip


def broken(uses: Rows) -> list[str]:
    """Which bars do not hold, a line each; none: all hold."""
    found = []
    for use in uses:
        who = f"{use['kernel']}{', evaluating fibres,' * use['evaluates']} on {use['target']}"
        if use["spills"] > SPILLS:
            found.append(f"{who}: spills {use['spills']}")
        if use["kernel"].startswith("intersect") and use["stack"] > TRAVERSAL_STACK:
            found.append(f"{who}: stack {use['stack']} bytes, {TRAVERSAL_STACK} allowed")
        shade = use["kernel"] == "shade" and not use["evaluates"]
        if shade and use["target"] in NVIDIA and use["registers"] > SHADE_REGISTERS:
            found.append(f"{who}: {use['registers']} registers, {SHADE_REGISTERS} allowed")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tools", type=Path, default=Path("out/gpu-tools"))
    parser.add_argument("-o", "--out", type=Path, default=Path("out/gpu-check"))
    parser.add_argument("--pairs", action="store_true", help="all rows of the compile matrix")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    tools = Tools(arguments.tools)
    rows = rows_of_matrix(arguments.pairs)
    with tempfile.TemporaryDirectory() as folder:
        uses = check(tools, rows, Path(folder), arguments.jobs)
    failures = broken(uses)
    results = {
        **software(),
        "command": " ".join(["python", *sys.argv]),
        "date": time.strftime("%Y-%m-%d"),
        "tools": tools.versions(),
        "targets": TARGETS,
        "variants": len(rows),
        "uses": uses,
        "broken": failures,
    }
    write_json(results, arguments.out / "results.json")
    print("\n".join(failures) or "all bars hold")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
