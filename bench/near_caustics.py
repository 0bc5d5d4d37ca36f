"""A fibre 100 pixels wide that one lamp goes round: light that is reflected once inside it (TRT)
and its caustic, for docs/models/index.md.

python bench/near_caustics.py [-o docs/pictures/caustics.png] [--device TEXT]

Rows are renders with the lamp at azimuths from the side of the camera (top) to behind the fibre.
Prints where TRT ends, and what the picture has there.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from furcl.device.choice import Device, open_device
from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene
from furcl.scene.tables import Scene

SIGMA = [0.1, 0.15, 0.25]
WIDE, WIDTH, ROWS = 100, 116, 2
DEGREES = np.arange(0.0, 181.0, 1.5)
ETA = 1.55
# Smooth around the fibre, so that the caustic is narrow; marschner has no offset, so no near field.
FIBRES: dict[str, dict[str, Any]] = {
    "chiang": {"sigma_a": SIGMA, "beta_n": 0.1, "eta": ETA, "alpha_deg": 0.0, "mode": "near"},
    "double-cylinder": {
        "sigma_ca": SIGMA, "kappa": 0.0, "beta_m_deg": 8.0, "beta_n_deg": 2.0, "eta": ETA,
        "layers": 0.5, "mode": "near",
    },
    "marschner": {"sigma_a": SIGMA, "eta": ETA, "alpha_deg": 0.0, "caustic_width_deg": 2.0},
}  # fmt: skip
EXPOSURES = {"all lobes": 1.5, "TRT": 12.0}


def caustic_degrees() -> float:
    """The azimuth beyond which no light of TRT leaves, in the plane across the fibre [deg]."""
    gamma = np.arcsin(np.sqrt((4.0 - ETA**2) / 3.0))
    return float(np.degrees(4.0 * np.arcsin(np.sin(gamma) / ETA) - 2.0 * gamma))


def strip(model: str, degrees: float) -> Scene:
    """The fibre, along the picture's rows, with the lamp at an azimuth from the camera's."""
    phi = np.radians(degrees)
    return decode_scene(
        {
            "film": {"width": WIDTH, "height": ROWS, "filter": "box", "layers": ["lobes"]},
            "camera": {
                "origin": [0.0, -2000.0, 0.0], "target": [0.0, 0.0, 0.0], "up": [1.0, 0.0, 0.0],
                "projection": "orthographic", "height": 2.0 * ROWS / WIDE,
            },
            "fibre": {"model": model, **FIBRES[model]},
            "lamp": {
                "sun": {
                    "kind": "distant", "target": [0.0, 0.0, 0.0], "angle_deg": 0.0,
                    "position": [0.0, -100.0 * float(np.cos(phi)), 100.0 * float(np.sin(phi))],
                    "irradiance": 1.0,
                }
            },
            "curves": {"generator": "fibre", "axis": "x", "radius": 1.0, "length": 1000.0},
            "render": {"max_depth": 1, "light_sampling": "mis"},
        },
        "caustics",
    )  # fmt: skip


def strips(model: str, device: Device, spp: int) -> dict[str, np.ndarray]:
    """All lobes, and TRT alone, (azimuths, WIDTH, 3) radiance."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in EXPOSURES}
    for degrees in DEGREES:
        renderer = Renderer(strip(model, float(degrees)), device)
        renderer.advance(spp)
        image = renderer.image()
        parts["all lobes"].append(image.rgb.mean(0))
        trt = np.stack([image.layers[f"lobe_TRT.{channel}"] for channel in "RGB"], -1)
        parts["TRT"].append(trt.mean(0))
    return {name: np.stack(rows).astype(np.float64) for name, rows in parts.items()}


def panel(radiance: np.ndarray, exposure: float, name: str) -> Image.Image:
    """A picture of strips, with its name over it."""
    exposed = np.clip(exposure * radiance, 0.0, 1.0)
    encoded = np.where(exposed <= 0.0031308, 12.92 * exposed, 1.055 * exposed ** (1 / 2.4) - 0.055)
    pixels = np.repeat((255.0 * encoded + 0.5).astype(np.uint8), ROWS, axis=0)
    whole = Image.new("RGB", (pixels.shape[1], pixels.shape[0] + 32))
    whole.paste(Image.fromarray(pixels), (0, 32))
    draw = ImageDraw.Draw(whole)
    for line, text in enumerate(name.split("\n")):
        draw.text((4, 3 + 13 * line), text, fill="white")
    return whole


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/pictures/caustics.png"))
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--device")
    asked = parser.parse_args()
    device = open_device(asked.device)
    panels = []
    print(f"TRT ends at {caustic_degrees():.1f} deg")
    for model in FIBRES:
        found = strips(model, device, asked.spp)
        trt = found["TRT"].sum(-1)
        row, column = np.unravel_index(trt.argmax(), trt.shape)
        h = (WIDTH / 2 - 0.5 - column) / (WIDE / 2)
        print(
            f"{model}: TRT is brightest with the lamp at {DEGREES[row]:g} deg, at h {h:.2f}; "
            f"{trt.max() / trt.mean():.1f} times the mean"
        )
        panels += [
            panel(found[name], exposure, f"{model}\n{name}") for name, exposure in EXPOSURES.items()
        ]
    gap = 4
    size = (sum(p.width + gap for p in panels) - gap, panels[0].height)
    whole = Image.new("RGB", size, "white")
    for i, part in enumerate(panels):
        whole.paste(part, (i * (part.width + gap), 0))
    whole.save(asked.output, optimize=True)
    print(asked.output)


if __name__ == "__main__":
    main()
