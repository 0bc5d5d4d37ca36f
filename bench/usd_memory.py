"""What reading USD takes: peak memory of usd-core's process over the size of the file.

python bench/usd_memory.py [--strands 60000]

A groom of 20 points a strand with widths and colours of each point, binary and as text. Printed are
the peak of the whole extraction and that of opening the stage alone, which is usd-core's.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from furcl.groom.curves import Curves
from furcl.groom.formats import save_curves

CHILD = """
import os, sys
from furcl.groom.formats import usd_stage
for name in ("Usd", "UsdGeom", "UsdShade"):
    usd_stage.pxr(name)
def status(key):
    lines = open("/proc/self/status").readlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) * 1024
before = status("VmRSS")
if sys.argv[2] == "open":
    stage = usd_stage.pxr("Usd").Stage.Open(sys.argv[1])
else:
    with os.fdopen(os.memfd_create("usd"), "wb") as file:
        usd_stage.write_result(sys.argv[1], file)
print(status("VmHWM") - before)
"""


def peak_bytes(path: Path, what: str) -> int:
    """Memory of a process that reads a stage, beyond that of usd-core itself."""
    command = [sys.executable, "-c", CHILD, str(path), what]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def groom(n_strands: int, seed: int = 0) -> Curves:
    rng = np.random.default_rng(seed)
    n = 20 * n_strands
    return Curves.from_arrays(
        rng.random((n, 3), np.float32),
        0.001 + 0.001 * rng.random(n, np.float32),
        np.arange(0, n + 1, 20),
        colours=rng.random((n, 3), np.float32),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--strands", type=int, default=60_000)
    given = parser.parse_args()
    curves = groom(given.strands)
    print("format   file MiB   all / file   open / file")
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".usdc", ".usda"):
            path = Path(folder) / f"groom{suffix}"
            save_curves(curves, path)
            size = path.stat().st_size
            ratios = [peak_bytes(path, what) / size for what in ("all", "open")]
            print(f"{suffix:<8} {size / 2**20:8.1f} {ratios[0]:12.1f} {ratios[1]:13.1f}")


if __name__ == "__main__":
    main()
