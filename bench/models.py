"""Fibre models side by side, for docs/models/index.md: shares of lobes, albedos of white fibres,
the cost of a hit, and a picture of the same groom in each.

python bench/models.py [-o bench/results/models] [--rounds N] [--picture FILE] [--device TEXT]
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from furcl.bench.record import circumstances, write_json
from furcl.bench.stages import timed_round
from furcl.device.choice import Device, open_device
from furcl.fibre import model as models
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene
from furcl.scene.tables import Scene

SCENE = Path(__file__).parents[1] / "scenes" / "black_hair.toml"
BROWN = "sigma_a=[0.58, 0.99, 1.99]"
# The same brown hair in each model, as keys of [fibre]; what white is beside it.
FIBRES = {
    "double-cylinder": (
        "sigma_ca=[0.58, 0.99, 1.99], kappa=0.0, beta_m_deg=8, beta_n_deg=12",
        "sigma_ca=0.0, kappa=0.0, beta_m_deg=8, beta_n_deg=12",
    ),
    "chiang": (BROWN, "sigma_a=0.0"),
    # A clear medulla, nearly of air.
    "yan2015": (
        "sigma_ca=[0.58, 0.99, 1.99], kappa=0.4, eta_m=1.2, beta_m_deg=8, beta_n_deg=12",
        "sigma_ca=0.0, kappa=0.4, eta_m=1.2, beta_m_deg=8, beta_n_deg=12",
    ),
    "deon": (f"{BROWN}, beta_m_deg=8, beta_n_deg=12", "sigma_a=0.0, beta_m_deg=8, beta_n_deg=12"),
    "marschner": (f"{BROWN}, beta_deg=4, alpha_deg=3", "sigma_a=0.0, beta_deg=4, alpha_deg=3"),
    # R as it is, the others in the colour that the absorption gives one and two crossings.
    "sadeghi": (
        "intensity_r=0.05, intensity_tt=[4.0, 2.4, 0.8], intensity_trt=[0.01, 0.004, 0.001]",
        "intensity_r=0.05, intensity_tt=7.0, intensity_trt=0.02",
    ),
}
DEGREES = (0.0, 60.0)
ROUND_SPP = 2


def fibre_of(model: str, keys: str) -> Any:
    """The fibre of a scene with these keys."""
    return load_scene(SCENE, overrides=[f"fibre={{model='{model}', {keys}}}"]).build_fibre()


def scene_of(model: str, *overrides: str) -> Scene:
    """The groom in a model, small."""
    smaller = [
        f"fibre={{model='{model}', {FIBRES[model][0]}}}", "curves.n_strands=6000",
        "curves.radius=0.006", "film.width=200", "film.height=240", "camera.vfov_deg=30",
        "render.light_sampling=mis",
    ]  # fmt: skip
    return load_scene(SCENE, overrides=[*smaller, *overrides])


def properties(model: str) -> dict[str, Any]:
    """Shares of the lobes of brown hair, and albedos of a white fibre."""
    reference = import_module(models.find(model).reference)
    brown, white = (fibre_of(model, keys) for keys in FIBRES[model])
    theta = np.radians(DEGREES)
    return {
        "shares": reference.lobe_shares(brown, residual=True),
        "albedos": [float(reference.albedo(white, t, residual=True)[0]) for t in theta],
    }


def costs(device: Device, rounds: int) -> dict[str, float]:
    """Nanoseconds of a hit on a fibre in the kernels that know the model: of rounds in turn the
    least, which is what other work on the machine disturbs least."""
    renderers = {name: Renderer(scene_of(name), device) for name in FIBRES}
    for renderer in renderers.values():
        renderer.advance(1)
    least = dict.fromkeys(FIBRES, np.inf)
    for _ in range(rounds):
        for name, renderer in renderers.items():
            found = timed_round(renderer, ROUND_SPP)
            ms = sum(
                row["ms"] for row in found["stages"] if row["stage"] in ("sample_lobe_h", "shade")
            )
            least[name] = min(least[name], 1e6 * ms / found["fibre_hits"])
    return {name: float(ns) for name, ns in least.items()}


def picture(device: Device, path: Path, spp: int = 64) -> None:
    """The groom in every model, beside each other with their names."""
    parts = []
    for name in FIBRES:
        renderer = Renderer(scene_of(name, f"render.spp={spp}"), device)
        renderer.advance(spp)
        image = renderer.image()
        exposed = np.clip(2.8 * image.rgb, 0.0, 1.0)
        encoded = np.where(
            exposed <= 0.0031308, 12.92 * exposed, 1.055 * exposed ** (1 / 2.4) - 0.055
        )
        part = Image.fromarray((255.0 * encoded + 0.5).astype(np.uint8))
        ImageDraw.Draw(part).text((6, 6), name, fill="white")
        parts.append(part)
    whole = Image.new("RGB", (sum(p.width for p in parts), parts[0].height))
    for i, part in enumerate(parts):
        whole.paste(part, (i * part.width, 0))
    whole.save(path, optimize=True)
    print(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("bench/results/models"))
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--device")
    asked = parser.parse_args()
    device = open_device(asked.device)
    if asked.picture:
        picture(device, asked.picture)
        return
    rows = {name: properties(name) for name in FIBRES}
    for name, ns in costs(device, asked.rounds).items():
        rows[name]["ns_a_hit"] = ns
    results = {"schema": "furcl-models-1", **circumstances(device), "models": rows}
    asked.output.mkdir(parents=True, exist_ok=True)
    write_json(results, asked.output / "results.json")


if __name__ == "__main__":
    main()
