"""Small renders on oclgrind, a simulated GPU: data races, reads and writes outside of buffers, and
where the simulator can tell them uninitialised values.

python bench/oclgrind_check.py [--tools FOLDER] [-o OUT] [CASE...]

`make oclgrind-check` does it, with the simulator that bench/install_oclgrind.sh puts into a
folder. It takes kernels instruction by instruction, so pictures are of few pixels, and what is
computed once for a scene, such as attenuation tables, another device makes. The pictures must be
those of that device. Prints what was found, and which values of the compile matrix
(furcl/bench/variants.py) no case has; ends with 1 if anything was found.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from small_render import BEYOND, CASES, FILLED, RACE, SIZE, SPP, Report

from furcl.bench.record import write_json
from furcl.bench.variants import VALUES
from furcl.version import software

PLATFORM = "Oclgrind"
TIMEOUT_S = 1200.0
#: Kernels with faults on purpose, and what must be told of them.
FAULTS = {RACE: "data race", BEYOND: "Invalid write"}
#: Pictures of the same samples differ where rounding sends a path another way.
MOST_DIFFERENCE = 0.01


def found_in(log: str) -> list[str]:
    """What the simulator's log tells of, a line each: the kernel, what, and where; each once."""
    found = {}
    for report in re.split(r"^(?=\S)", log, flags=re.MULTILINE):
        lines = [line.strip() for line in report.splitlines()]
        if not report.strip():
            continue
        what = re.sub(r"0x[0-9a-f]+", "...", lines[0])
        kernel = next((x.removeprefix("Kernel: ") for x in lines if x.startswith("Kernel: ")), "?")
        places = dict.fromkeys(x.removesuffix(":") for x in lines if x.startswith("At line "))
        found[", ".join([f"{kernel}: {what}", *places])] = None
    return list(found)


def environment(tools: Path, folder: Path, log: Path, uninitialised: bool) -> dict[str, str]:
    """This process's environment with one more platform: the simulator, which looks for races, and
    for uninitialised values if wanted."""
    vendors = folder / "vendors"
    vendors.mkdir()
    for file in Path(os.environ.get("OCL_ICD_VENDORS", "/etc/OpenCL/vendors")).glob("*.icd"):
        shutil.copy(file, vendors)
    (vendors / "oclgrind.icd").write_text(f"{tools / 'usr/lib/oclgrind/liboclgrind-rt-icd.so'}\n")
    libraries = [str(tools / "usr/lib/x86_64-linux-gnu"), os.environ.get("LD_LIBRARY_PATH", "")]
    return {
        **os.environ,
        "OCL_ICD_VENDORS": str(vendors),
        "LD_LIBRARY_PATH": ":".join(filter(None, libraries)),
        # What furcl keeps of kernels does not know of the options below.
        "FURCL_CACHE_DIR": str(folder / "cache"),
        # Optimised code has instructions that the simulator does not know.
        "OCLGRIND_BUILD_OPTIONS": "-cl-opt-disable",
        "OCLGRIND_DATA_RACES": "1",
        **({"OCLGRIND_UNINITIALIZED": "1"} if uninitialised else {}),
        "OCLGRIND_MAX_ERRORS": "100",
        "OCLGRIND_LOG": str(log),
    }


def run(case: str, tools: Path, uninitialised: bool = False) -> Report:
    """A case in a process of its own: its report, and as `found` what is wrong with it."""
    with tempfile.TemporaryDirectory() as temporary:
        log = Path(temporary) / "log.txt"
        try:
            ended = subprocess.run(
                [sys.executable, str(Path(__file__).with_name("small_render.py")), case, PLATFORM],
                env=environment(tools, Path(temporary), log, uninitialised),
                capture_output=True,
                text=True,
                timeout=TIMEOUT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return {"case": case, "found": [f"not ready after {TIMEOUT_S:g} s"]}
        found = found_in(log.read_text(errors="replace")) if log.exists() else []
    if ended.returncode:
        last = ended.stderr.strip().splitlines()[-1:]
        return {"case": case, "found": [*found, f"code {ended.returncode}: {''.join(last)}"]}
    report: Report = json.loads(ended.stdout.strip().splitlines()[-1])
    return {"case": case, **report, "found": found + wrong_picture(report)}


def wrong_picture(report: Report) -> list[str]:
    """What is wrong with the picture of a report, if it has one."""
    if "mean" not in report:
        return []
    mean, there = report["mean"], report["mean_elsewhere"]
    wrong = [] if report["hits"] > 0.0 else ["no path meets a fibre"]
    if not abs(mean - there) <= MOST_DIFFERENCE * abs(there):
        wrong.append(f"mean radiance {mean:.6g}, on another device {there:.6g}")
    return wrong


def never(reports: list[Report]) -> dict[str, list[str]]:
    """The plain values of the compile matrix that no report has, by field."""
    missing = {}
    for field, values in VALUES.items():
        had = {value for report in reports for value in report.get("values", {}).get(field, ())}
        wanted = {repr(value) for value in values if isinstance(value, str | int | tuple)}
        if wanted - had:
            missing[field] = sorted(wanted - had)
    return missing


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; or all")
    parser.add_argument("--tools", type=Path, default=Path("out/oclgrind"))
    parser.add_argument("-o", "--out", type=Path, default=Path("out/oclgrind-check"))
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.cases) - set(CASES))
    if unknown:
        parser.error(f"no case {', '.join(unknown)}; there are {', '.join(CASES)}")
    tools = arguments.tools.resolve()
    if not (tools / "usr/lib/oclgrind").is_dir():
        parser.error(f"no oclgrind in {tools}: run bash bench/install_oclgrind.sh {tools}")
    for kernel, told in FAULTS.items():
        if not any(told in line for line in run(kernel, tools)["found"]):
            print(f"no {told!r} was told of {kernel}: the check is of no use", file=sys.stderr)
            return 1
    uninitialised = not run(FILLED, tools, uninitialised=True)["found"]
    if not uninitialised:
        print("uninitialised values are not looked for: filled buffers are taken for such")
    reports = []
    for case in arguments.cases or CASES:
        start = time.monotonic()
        reports.append(run(case, tools, uninitialised))
        told = "\n  ".join(reports[-1]["found"]) or "nothing found"
        print(f"{case}, {time.monotonic() - start:.0f} s: {told}", flush=True)
    missing = never(reports)
    results = {
        **software(),
        "command": " ".join(["python", *sys.argv]),
        "date": time.strftime("%Y-%m-%d"),
        "size": SIZE,
        "spp": SPP,
        "uninitialised": uninitialised,
        "reports": reports,
        "never": missing,
    }
    write_json(results, arguments.out / "results.json")
    print("of the compile matrix no case has:")
    for field, values in missing.items():
        print(f"  {field}: {', '.join(values)}")
    return 1 if any(report["found"] for report in reports) else 0


if __name__ == "__main__":
    sys.exit(main())
