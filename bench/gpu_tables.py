"""Tables of docs/gpu.md: bench/results/gpu_check."""

from __future__ import annotations

from gpu_check import SHADE_REGISTERS, TRAVERSAL_STACK
from tables import Results, load, table

RESULTS = "gpu_check/results.json"


def circumstances() -> str:
    """Tools, date, commit and command."""
    found = load(RESULTS)
    tools = ", ".join(f"{name} {version}" for name, version in found["tools"].items())
    return (
        f"{tools}, {found['date']}, commit {found.get('git', 'unknown')}, {found['variants']} "
        f"variants:\n\n    {found['command']}"
    )


def cell(use: Results) -> str:
    """Registers / bytes of stack, and spills where there are some."""
    spills = f", spills {use['spills']}" if use["spills"] else ""
    scalars = f" + {use['scalars']}" if use["scalars"] else ""
    return f"{use['registers']}{scalars} / {use['stack']}{spills}"


def kernels() -> str:
    """A kernel a row, in variants that evaluate fibres and in others, a GPU a column."""
    found = load(RESULTS)
    cells: dict[tuple[str, bool], dict[str, str]] = {}
    for use in found["uses"]:
        cells.setdefault((use["kernel"], use["evaluates"]), {})[use["target"]] = cell(use)
    rows = [
        [kernel, "yes" if sampled else "no", *(of_target[t] for t in found["targets"])]
        for (kernel, sampled), of_target in sorted(cells.items())
    ]
    return table(["kernel", "evaluates fibres", *found["targets"]], rows)


def bars() -> str:
    """What is asked for, and where it does not hold."""
    broken = load(RESULTS)["broken"]
    lines = [f"* {line}" for line in broken] or ["All hold."]
    return "\n".join(
        [
            (
                f"No spills; at most {TRAVERSAL_STACK} bytes of stack where rays go through the "
                f"tree; at most {SHADE_REGISTERS} of NVIDIA's registers in `shade` where it "
                f"evaluates no fibre."
            ),
            "",
            *lines,
        ]
    )


TABLES = {"gpu-circumstances": circumstances, "gpu-bars": bars, "gpu-kernels": kernels}
