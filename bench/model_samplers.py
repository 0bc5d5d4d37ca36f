"""What samplers gain on every fibre model, far and near, in the scenes of the paper: RMSE over that
of uniform-h at equal samples, for docs/results.md.

    python bench/model_samplers.py [MODEL...] [-o FOLDER] [--device TEXT] [--quick]

With the settings of the paper's comparison: fibres alone are sampled, numbers are independent.
Renders are kept in out/model_samplers, where a run that was stopped goes on. Samplers that are the
same by construction are not run: without a medulla full-cdf is attenuation-cdf, and in the near
field attenuation-cdf is uniform-h.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tables import FOLDER

from furcl.bench.convergence import run
from furcl.bench.convergence_plan import Plan
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.progress import progress_report
from furcl.scene.read import load_scene
from furcl.scene.tables import Scene

SCENES = Path(__file__).parents[1] / "scenes"
KEPT = Path("out/model_samplers")
# The fibre of each scene: presets of models with a medulla, and of those without.
PRESETS = {
    "black_hair": ("human-black", "black"),
    "white_hair": ("human-white", "white"),
    "raccoon": ("raccoon", "brown"),
    "single_fibre": ("human-black", "black"),
}
MEDULLA = ("double-cylinder", "yan2015")
MODELS = (*MEDULLA, "chiang", "deon", "marschner")
NO_OFFSET = ("marschner",)
SAMPLERS = {
    ("far", True): ("uniform-h", "attenuation-cdf", "full-cdf"),
    ("far", False): ("uniform-h", "attenuation-cdf"),
    ("near", True): ("uniform-h", "full-cdf", "all-lobes"),
    ("near", False): ("uniform-h", "all-lobes"),
}
COMPARED_AS_THE_PAPER = (
    "render.light_sampling=bcsdf", "render.sequence=independent", "render.roulette=depth",
    "render.allocation=even",
)  # fmt: skip
SIZE, SPP, REFERENCE_SPP = (32, 32), (16, 64), 512


def scene_of(name: str, model: str, mode: str, size: tuple[int, int]) -> Scene:
    """A scene of the paper with the fibre in a model."""
    preset = PRESETS[name][model not in MEDULLA]
    changes = [
        f"fibre={{model='{model}', preset='{preset}', mode='{mode}'}}", f"name='{name}'",
        *COMPARED_AS_THE_PAPER,
    ]  # fmt: skip
    if name == "single_fibre":
        # It fills the picture, in even light: what is left is the spread of the weights.
        changes.append("camera.vfov_deg=2")
    return load_scene(SCENES / f"{name}.toml", overrides=changes, size=size)


def compared(model: str, mode: str, device: Device, quick: bool) -> list[dict[str, Any]]:
    """Rows of all scenes and samplers: the ratio at the largest number of samples, with its 95 %
    interval."""
    size = (8, 8) if quick else SIZE
    plan = Plan(
        tuple(scene_of(name, model, mode, size) for name in PRESETS),
        sampling=SAMPLERS[mode, model in MEDULLA],
        spp=(2, 4) if quick else SPP,
        runs=2 if quick else 5,
        reference_spp=8 if quick else REFERENCE_SPP,
    )
    folder = KEPT / f"{model}-{mode}{'-quick' if quick else ''}"
    with progress_report() as report:
        results = run(plan, folder, device=device, progress=lambda *at: bool(report(*at)))
    rows = []
    for scene in results["scenes"]:
        for found in scene["comparisons"]:
            ratio = found["same_spp"][-1]["rmse_ratio"]
            row = {"model": model, "mode": mode, "scene": scene["name"]}
            rows.append({**row, "sampler": found["variant"], "ratio": ratio})
            print(*rows[-1].values())
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("models", nargs="*", help=", ".join(MODELS))
    parser.add_argument("-o", "--output", type=Path, default=FOLDER)
    parser.add_argument("--device")
    parser.add_argument("--quick", action="store_true")
    asked = parser.parse_args()
    device = open_device(asked.device)
    rows = []
    for model in asked.models or MODELS:
        for mode in ("far",) if model in NO_OFFSET else ("far", "near"):
            rows += compared(model, mode, device, asked.quick)
    settings = {"size": SIZE, "spp": SPP, "reference_spp": REFERENCE_SPP}
    results = {"schema": "furcl-model-samplers-1", **circumstances(device), **settings}
    write_json({**results, "rows": rows}, asked.output / "model_samplers.json")


if __name__ == "__main__":
    main()
