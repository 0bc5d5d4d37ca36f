"""furcl beside other renderers, live: the same scene, in turns, with the errors of each.

python bench/peers.py -o bench/results/peers/NAME [--peers out/peers] [--device D]

`bash bench/install_peers.sh out/peers` installs the others into a folder of their own. The scene:
the grooms of bench/peer_grooms.py, a scalp as a mesh, even light and a square lamp, the fibre of
Chiang et al. 2016; once with the same settings (16 bounces, no roulette, independent numbers,
light samples at every vertex), once with those that each renderer has by itself. mitsuba-cuda
needs an NVIDIA GPU with OptiX, and is there by name only.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from peer_grooms import GROOMS, facts, grow
from scipy import stats

from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.groom.curves import Curves
from furcl.groom.formats import save_curves
from furcl.image.image import Image

FOLDER = Path(__file__).parent
SIZE, BOUNCES = 128, 16
LAMP = {"position": [-3.0, -3.0, 4.0], "target": [0.0, 0.0, 0.0], "size": 2.0, "radiance": 10.0}
FIBRE = {
    "sigma_a": [0.126, 0.209, 0.411],
    "beta_m": 0.3,
    "beta_n": 0.3,
    "alpha_deg": 2.0,
    "eta": 1.55,
}
# Name -> script, and what its task has beside.
RENDERERS: dict[str, tuple[str, dict[str, str]]] = {
    "furcl": ("peer_furcl.py", {}),
    "mitsuba-llvm": ("peer_mitsuba.py", {"variant": "llvm_ad_rgb", "shape": "bsplinecurve"}),
    "mitsuba-linear": ("peer_mitsuba.py", {"variant": "llvm_ad_rgb", "shape": "linearcurve"}),
    "mitsuba-cuda": ("peer_mitsuba.py", {"variant": "cuda_ad_rgb", "shape": "bsplinecurve"}),
    "mitsuba-scalar": ("peer_mitsuba.py", {"variant": "scalar_rgb", "shape": "bsplinecurve"}),
    "cycles": ("peer_cycles.py", {}),
}


class Worker:
    """A renderer in its process.

    Parameters
    ----------
    name : str          of RENDERERS
    task : path         the file of its task
    peers : path        where the packages of other renderers are
    log : path          what it writes
    """

    def __init__(self, name: str, task: Path, peers: Path, log: Path) -> None:
        script, _ = RENDERERS[name]
        environment = dict(os.environ)
        if name != "furcl":
            environment["PYTHONPATH"] = str(peers.resolve())
            llvm = next(peers.glob("llvm/**/libLLVM*.so*"), None)
            if llvm:
                environment.setdefault("DRJIT_LIBLLVM_PATH", str(llvm.resolve()))
        self._log = log.open("w", encoding="utf-8")
        self.process = subprocess.Popen(
            [sys.executable, str(FOLDER / script), str(task)],
            env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log,
            text=True,
        )  # fmt: skip
        self.name, self.log = name, log
        self.version: str = self._answer()["version"]

    def _answer(self) -> dict[str, Any]:
        assert self.process.stdout
        line = self.process.stdout.readline()
        if not line:
            tail = self.log.read_text(encoding="utf-8", errors="replace")[-600:]
            raise SystemExit(f"{self.name} ended: {tail}")
        return json.loads(line)

    def render(self, seed: int, spp: int, out: Path) -> tuple[float, np.ndarray]:
        """Seconds, and the picture."""
        assert self.process.stdin
        self.process.stdin.write(json.dumps({"seed": seed, "spp": spp, "out": str(out)}) + "\n")
        self.process.stdin.flush()
        return self._answer()["seconds"], np.load(out).astype(np.float64)

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        self._log.close()


def sphere_ply(path: Path, n_around: int = 64, n_down: int = 32) -> None:
    """A unit sphere of triangles."""
    down, around = np.meshgrid(
        np.pi * np.arange(n_down + 1) / n_down,
        2 * np.pi * np.arange(n_around + 1) / n_around,
        indexing="ij",
    )
    corners = np.stack(
        [np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], -1
    ).reshape(-1, 3)
    first = (np.arange(n_down)[:, None] * (n_around + 1) + np.arange(n_around)).ravel()
    below = first + n_around + 1
    upper = np.stack([first, below, first + 1], 1)[n_around:]
    lower = np.stack([first + 1, below, below + 1], 1)[:-n_around]
    faces = np.concatenate([upper, lower])
    head = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines = [*head, *(f"{x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners)]
    path.write_text("\n".join([*lines, *(f"3 {a} {b} {c}" for a, b, c in faces), ""]), "ascii")


def smooth(groom: Curves) -> tuple[Curves, Curves]:
    """The uniform cubic B-splines whose control points a groom has, and the polylines through their
    knots: what renderers of curves and furcl have of the same fibres.

    The control points have one more at each end, so that a spline begins and ends where its
    strand does.
    """
    n_points = np.diff(groom.offsets.astype(np.int64))
    rows = np.column_stack([groom.points, groom.radii]).astype(np.float64)
    strands = rows.reshape(len(n_points), n_points[0], 4)
    first, last = 2 * strands[:, :1] - strands[:, 1:2], 2 * strands[:, -1:] - strands[:, -2:-1]
    first[..., 3], last[..., 3] = strands[:, :1, 3], strands[:, -1:, 3]  # or tips turn inside out
    control = np.concatenate([first, strands, last], axis=1)
    knots = (control[:, :-2] + 4 * control[:, 1:-1] + control[:, 2:]) / 6
    return _curves(control), _curves(knots)


def _curves(strands: np.ndarray) -> Curves:
    """Curves of (strands, points, 4)."""
    rows = strands.reshape(-1, 4).astype(np.float32)
    offsets = np.arange(len(strands) + 1, dtype=np.uint32) * strands.shape[1]
    return Curves.from_arrays(rows[:, :3], rows[:, 3], offsets)


def task_of(groom: str, name: str, same: bool, given: argparse.Namespace) -> dict[str, Any]:
    """What a renderer is asked to make ready; its groom and scalp are files beside it."""
    scene = facts(groom)
    return {
        "groom": groom, "size": given.size, "bounces": BOUNCES, "same_settings": same,
        "camera": scene["camera"], "environment": scene["environment"]["radiance"],
        "scalp_albedo": scene["body"]["albedo"], "lamp": LAMP, "fibre": FIBRE,
        "device": given.device, **RENDERERS[name][1],
    }  # fmt: skip


@contextlib.contextmanager
def workers(
    names: list[str], groom: str, same: bool, given: argparse.Namespace, folder: Path
) -> Iterator[list[Worker]]:
    """The renderers with a scene, each in its process."""
    started: list[Worker] = []
    try:
        for name in names:
            task = task_of(groom, name, same, given)
            path = folder / f"{groom}-{name}.json"
            path.write_text(json.dumps(task), encoding="utf-8")
            started.append(Worker(name, path, given.peers, path.with_suffix(".log")))
        yield started
    finally:
        for worker in started:
            worker.close()


def measure(
    found: list[Worker], rounds: int, spp: int, folder: Path
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Seconds (rounds,) and pictures (rounds, H, W, 3) of each, in turns; the first of each, in
    which it may still compile, does not count."""
    seconds: dict[str, list[float]] = {worker.name: [] for worker in found}
    pictures: dict[str, list[np.ndarray]] = {worker.name: [] for worker in found}
    for seed in range(rounds + 1):
        for worker in found:
            passed, picture = worker.render(seed, spp, folder / f"{worker.name}.npy")
            if seed:
                seconds[worker.name].append(passed)
                pictures[worker.name].append(picture)
    return (
        {name: np.array(values) for name, values in seconds.items()},
        {name: np.stack(values) for name, values in pictures.items()},
    )


def log_efficiencies(seconds: np.ndarray, pictures: np.ndarray) -> np.ndarray:
    """log 1 / (MSE x seconds) of each round, MSE against the mean of the other rounds."""
    n = len(pictures)
    others = (pictures.sum(axis=0) - pictures) / (n - 1)
    mse = ((pictures - others) ** 2).mean(axis=(1, 2, 3)) * (n - 1) / n
    return -np.log(mse * seconds)


def of_groom(pictures: np.ndarray) -> np.ndarray:
    """Mean radiance of the middle of the pictures, where there is no background."""
    height, width = pictures.shape[1:3]
    middle = np.s_[:, height * 3 // 8 : height * 5 // 8, width * 3 // 8 : width * 5 // 8]
    return pictures[middle].mean(axis=(1, 2, 3))


def interval(values: np.ndarray) -> list[float]:
    """exp of the mean, and its 95 % interval."""
    half = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return [float(np.exp(values.mean() + side * half)) for side in (0, -1, 1)]


def compared(
    groom: str, same: bool, found: list[Worker], given: argparse.Namespace, folder: Path
) -> list[dict[str, Any]]:
    """A row a renderer."""
    seconds, pictures = measure(found, given.rounds, given.spp, folder)
    own = log_efficiencies(seconds["furcl"], pictures["furcl"])
    mean = of_groom(pictures["furcl"])
    rows = []
    for worker in found:
        name = worker.name
        theirs = log_efficiencies(seconds[name], pictures[name])
        row: dict[str, Any] = {
            "groom": groom, "settings": "same" if same else "own", "renderer": name,
            "version": worker.version, "spp": given.spp,
            "seconds": float(np.median(seconds[name])),
            "mpaths_s": given.size**2 * given.spp / float(np.median(seconds[name])) / 1e6,
            "efficiency": float(np.exp(theirs.mean())),
        }  # fmt: skip
        if name != "furcl":
            row["furcl_over_it"] = interval(own - theirs)
            row["radiance_over_furcl"] = interval(np.log(of_groom(pictures[name])) - np.log(mean))
        rows.append(row)
        if given.pictures:
            picture = Image(pictures[name].mean(axis=0).astype(np.float32))
            picture.save(given.pictures / f"{groom}-{row['settings']}-{name}.png")
        print(json.dumps(row), flush=True)
    return rows


def main() -> None:
    """Measure, and write results.json."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--peers", type=Path, default=Path("out/peers"))
    parser.add_argument("--device")
    parser.add_argument(
        "--renderers", default=",".join(name for name in RENDERERS if name != "mitsuba-cuda")
    )
    parser.add_argument("--size", type=int, default=SIZE)
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--pictures", type=Path, help="folder for the mean pictures")
    parser.add_argument("--strands", type=int, help="thin the grooms")
    given = parser.parse_args()
    names = given.renderers.split(",")
    unknown = [name for name in names if name not in RENDERERS]
    if unknown or "furcl" not in names:
        parser.error(f"--renderers {given.renderers}: furcl and some of {', '.join(RENDERERS)}")
    for folder in filter(None, (given.output, given.pictures)):
        folder.mkdir(parents=True, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        sphere_ply(folder / "scalp.ply")
        for groom in GROOMS:
            control, knots = smooth(grow(groom, given.strands))
            save_curves(control, folder / "control.npz")
            save_curves(knots, folder / "groom.npz")
            for same in (True, False):
                with workers(names, groom, same, given, folder) as found:
                    rows += compared(groom, same, found, given, folder)
    here = circumstances(open_device(given.device))
    write_json({**here, "rounds": given.rounds, "rows": rows}, given.output / "results.json")


if __name__ == "__main__":
    main()
