"""Tables of docs/gpu.md: bench/results/gpu_check and oclgrind_check."""

from __future__ import annotations

from gpu_check import SHADE_REGISTERS, TRAVERSAL_STACK
from small_render import CASES
from tables import Results, load, table

RESULTS = "gpu_check/results.json"
SIMULATED = "oclgrind_check/results.json"


def of_run(found: Results, what: str) -> str:
    """Date, commit, what was taken, and command."""
    return (
        f"{found['date']}, commit {found.get('git', 'unknown')}, {what}:\n\n    {found['command']}"
    )


def circumstances() -> str:
    """Tools and run of bench/gpu_check.py."""
    found = load(RESULTS)
    tools = ", ".join(f"{name} {version}" for name, version in found["tools"].items())
    return f"{tools}, " + of_run(found, f"{found['variants']} variants")


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


def simulated_circumstances() -> str:
    """Run of bench/oclgrind_check.py."""
    found = load(SIMULATED)
    return of_run(found, f"{found['size']} pixels, {found['spp']} samples a pixel")


def simulated() -> str:
    """A case a row."""
    rows = []
    for report in load(SIMULATED)["reports"]:
        rows.append(
            [
                report["case"],
                CASES[report["case"]][0],
                str(len(report["stages"])),
                f"{report['hits']:.2f}",
                f"{report['mean'] / report['mean_elsewhere'] - 1.0:+.1e}",
                "; ".join(report["found"]) or "nothing",
            ]
        )
    return table(
        ["case", "scene", "kernels", "hits a path", "mean against the other device", "found"], rows
    )


def never_simulated() -> str:
    """The values of the compile matrix that no case has."""
    missing = load(SIMULATED)["never"]
    return "; ".join(f"{field}: {', '.join(values)}" for field, values in missing.items()) + "."


TABLES = {
    "gpu-circumstances": circumstances,
    "gpu-bars": bars,
    "gpu-kernels": kernels,
    "oclgrind-circumstances": simulated_circumstances,
    "oclgrind": simulated,
    "oclgrind-never": never_simulated,
}
