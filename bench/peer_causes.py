"""What makes the radiance of bench/peers.py's renderers differ, one possible cause a row.

python bench/peer_causes.py -o bench/results/peer_causes [--peers out/peers] [--device D] [--spp N]

Each row renders the same scene, changed as it says, with furcl and with others, and prints their
mean radiance over furcl's with its standard error. The camera sees fibres and scalp alone.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from peer_grooms import GROOMS, grow
from peers import Worker, smooth, sphere_ply, task_of

from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.groom.curves import Curves
from furcl.groom.formats import save_curves

ROUNDS = 5
DARK = {"radiance": 1e-4}  # a lamp that hides what is behind it and gives no light
NIGHT = {"environment": [0.0, 0.0, 0.0]}
BLACK = {"scalp_albedo": [0.0, 0.0, 0.0]}
ONE = {"bounces": 1, **BLACK}
STRAND = {"origin": [0.0, -4.5, 1.2], "target": [0.0, -1.7, 0.4], "vfov_deg": 3.0}
# Ways and radii: aslant, and towards the camera.
STRANDS = {
    "strand": ((0.6, 0.1, 0.8), 0.02),
    "towards the camera": ((0.2, -0.72, 0.24), 0.01),
    "towards the camera, thin": ((0.2, -0.72, 0.24), 0.0025),
}
PEERS: list[tuple[str, dict[str, Any]]] = [("mitsuba-llvm", {}), ("cycles", {})]
NEAR: list[tuple[str, dict[str, Any]]] = [("furcl", {"mode": "near"})]
OTHER_TILT = [("mitsuba-llvm", {"fibre": {"alpha_deg": -2.0}})]
# What is asked: groom, changes of the scene, and renderers beside furcl with changes of their own.
CASES: dict[str, tuple[str, dict[str, Any], list[tuple[str, dict[str, Any]]]]] = {
    "one fibre, even light": (
        "strand", {**ONE, "lamp": DARK, "camera": STRAND}, PEERS + NEAR + OTHER_TILT,
    ),
    "one fibre, the lamp alone": (
        "strand", {**ONE, **NIGHT, "camera": STRAND}, PEERS + NEAR + OTHER_TILT,
    ),
    **{
        f"one fibre {name}, even light": (name, {**ONE, "lamp": DARK, "camera": STRAND}, PEERS)
        for name in list(STRANDS)[1:]
    },
    "scalp, even light behind a dark lamp": (
        "strand", {"bounces": 1, "lamp": DARK, "camera": {**STRAND, "target": [0.6, 0.0, 0.5]}},
        PEERS,
    ),
    **{
        f"{groom}, even light, {depth} scatterings": (
            groom, {"bounces": depth, "lamp": DARK, "camera": {"vfov_deg": 12.0}}, PEERS + NEAR,
        )
        for groom in GROOMS
        for depth in (1, 2, 16)
    },
    **{
        f"{groom}, 16 scatterings": (groom, {"camera": {"vfov_deg": 12.0}}, PEERS + NEAR)
        for groom in GROOMS
    },
    "hair10k, polylines 8 times as fine, even light, 2 scatterings": (
        "hair10k", {"fine": 8, "bounces": 2, "lamp": DARK, "camera": {"vfov_deg": 12.0}}, PEERS,
    ),
    "hair10k, 4 times the strands, a quarter as wide, even light, 2 scatterings": (
        "hair10k", {"thinner": 4, "bounces": 2, "lamp": DARK, "camera": {"vfov_deg": 12.0}}, PEERS,
    ),
}  # fmt: skip


def strand(way: tuple[float, float, float], radius: float) -> Curves:
    """One straight strand before the scalp."""
    places = np.linspace(-0.5, 0.5, 8)[:, None]
    points = np.array([0.0, -1.7, 0.4]) + places * np.array(way)
    return Curves.from_arrays(
        points.astype(np.float32), np.full(8, radius, np.float32), np.array([0, 8], np.uint32)
    )


def grown(name: str, thinner: int) -> Curves:
    """A groom; of more strands, all together as wide as before."""
    if name in STRANDS:
        return strand(*STRANDS[name])
    groom = grow(name, GROOMS[name][0] * thinner)
    # `grow` keeps the share of the scalp that roots cover.
    radii = (groom.radii / np.sqrt(thinner)).astype(np.float32)
    return Curves.from_arrays(groom.points, radii, groom.offsets)


def finer(control: Curves, parts: int) -> Curves:
    """The polylines of splines, as many segments between two knots."""
    n_points = int(control.offsets[1])
    rows = np.column_stack([control.points, control.radii]).astype(np.float64)
    strands = rows.reshape(-1, n_points, 4)
    t = np.arange(parts) / parts
    basis = [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
    spans = np.stack([strands[:, i : n_points - 3 + i] for i in range(4)], axis=2)
    inner = np.einsum("kt,snkd->sntd", np.stack(basis) / 6, spans).reshape(len(strands), -1, 4)
    last = (strands[:, -3] + 4 * strands[:, -2] + strands[:, -1])[:, None] / 6
    points = np.concatenate([inner, last], axis=1)
    flat = points.reshape(-1, 4).astype(np.float32)
    offsets = np.arange(len(points) + 1, dtype=np.uint32) * points.shape[1]
    return Curves.from_arrays(flat[:, :3], flat[:, 3], offsets)


def changed(task: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A task with other values; tables of it keep those that are not named."""
    both = {
        key: {**task.get(key, {}), **value} if isinstance(value, dict) else value
        for key, value in changes.items()
    }
    return {**task, **both}


def radiance(
    name: str, task: dict[str, Any], folder: Path, given: argparse.Namespace
) -> np.ndarray:
    """Mean radiance (ROUNDS,) of independent pictures."""
    path = folder / "task.json"
    path.write_text(json.dumps(task), encoding="utf-8")
    worker = Worker(name, path, given.peers, folder / "log")
    try:
        seeds = range(1, ROUNDS + 1)
        pictures = [worker.render(seed, given.spp, folder / "picture.npy")[1] for seed in seeds]
    finally:
        worker.close()
    return np.array([picture.mean() for picture in pictures])


def measured(case: str, folder: Path, given: argparse.Namespace) -> list[dict[str, Any]]:
    """A row for each renderer beside furcl."""
    groom, changes, others = CASES[case]
    control, knots = smooth(grown(groom, changes.get("thinner", 1)))
    save_curves(control, folder / "control.npz")
    fine = changes.get("fine", 1)
    save_curves(finer(control, fine) if fine > 1 else knots, folder / "groom.npz")
    rows, own = [], np.zeros(0)
    for name, its in [("furcl", {}), *others]:
        scene = task_of(groom if groom in GROOMS else "hair10k", name, True, given)
        found = radiance(name, changed(changed(scene, changes), its), folder, given)
        if not len(own):
            own = found
            continue
        spread = np.hypot(*(x.std(ddof=1) / x.mean() for x in (found, own))) / np.sqrt(ROUNDS)
        ratio = float(found.mean() / own.mean())
        rows.append({"case": case, "renderer": name, "changes": its, "over_furcl": ratio,
                     "standard_error": float(ratio * spread)})  # fmt: skip
        print(json.dumps(rows[-1]), flush=True)
    return rows


def main() -> None:
    """Measure, and write results.json."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--peers", type=Path, default=Path("out/peers"))
    parser.add_argument("--device")
    parser.add_argument("--size", type=int, default=48)
    parser.add_argument("--spp", type=int, default=128)
    parser.add_argument("--cases", default="", help="only those whose names contain this")
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        sphere_ply(folder / "scalp.ply")
        for case in CASES:
            if given.cases in case:
                rows += measured(case, folder, given)
    here = circumstances(open_device(given.device))
    write_json({**here, "rounds": ROUNDS, "rows": rows}, given.output / "results.json")


if __name__ == "__main__":
    main()
