"""Draws docs/figures/architecture.png: python docs/make_flow.py."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

OUT = Path(__file__).parent / "figures" / "architecture.png"
HOST, DEVICE, DATA = "#dbe9f6", "#fde3c8", "#eeeeee"


class Box(NamedTuple):
    """A box by its middle; `folder` is written small below the title."""

    x: float
    y: float
    title: str
    folder: str
    colour: str
    width: float = 2.1


# Once a scene: from the file to what kernels take.
SCENE = Box(1.2, 8.2, "scene file", "furcl/scene/", HOST)
GROOM = Box(4.2, 9.2, "strands", "furcl/groom/", HOST)
TREE = Box(7.0, 9.2, "tree", "furcl/bvh/", HOST)
FIBRE = Box(4.2, 8.2, "material: parameters, tables", "furcl/fibre/  furcl/surface/", HOST, 2.7)
LIGHT = Box(4.2, 7.2, "light", "furcl/light/", HOST)
FEATURES = Box(7.0, 7.7, "features, kernel builds", "furcl/rendering/  furcl/device/", HOST, 2.3)
# Once a wave: the stages, from left to right.
GENERATE = Box(1.2, 4.8, "generate", "kernels/stages/generate.cl", DEVICE)
CLOSEST = Box(3.9, 4.8, "intersect_closest", "kernels/stages/intersect.cl", DEVICE)
ESCAPED = Box(6.6, 5.7, "shade_escaped", "kernels/stages/shade_escaped.cl", DEVICE)
SAMPLE = Box(6.6, 4.8, "sample_lobe_h", "kernels/stages/sample_lobe_h.cl", DEVICE)
SURFACE = Box(6.6, 3.9, "shade_surface", "kernels/stages/shade_surface.cl", DEVICE)
SHADE = Box(9.3, 4.8, "shade", "kernels/stages/shade.cl", DEVICE)
SHADOW = Box(9.3, 3.9, "intersect_shadow", "kernels/stages/intersect.cl", DEVICE)
STATE = Box(
    5.25,
    2.2,
    "path state: every stage works on the slots of its queue",
    "furcl/device/layout.py",
    DATA,
    10.2,
)
FILM = Box(1.2, 0.8, "add_to_film", "kernels/stages/film.cl", DEVICE)
SUMS = Box(4.2, 0.8, "film: sums, squares, counts", "furcl/rendering/film.py", DATA, 2.7)
IMAGE = Box(7.2, 0.8, "picture", "furcl/image/", HOST)
LEARN = Box(9.55, 0.8, "learn, at first", "kernels/stages/learn.cl", DEVICE, 2.2)
BOXES = (
    SCENE, GROOM, TREE, FIBRE, LIGHT, FEATURES, GENERATE, CLOSEST, ESCAPED, SAMPLE, SURFACE,
    SHADE, SHADOW, STATE, FILM, SUMS, IMAGE, LEARN,
)  # fmt: skip
HEIGHT = 0.62


def _draw(axes: Axes, box: Box) -> None:
    corner = (box.x - 0.5 * box.width, box.y - 0.5 * HEIGHT)
    style = "round,pad=0.02,rounding_size=0.08"
    axes.add_patch(
        FancyBboxPatch(corner, box.width, HEIGHT, style, facecolor=box.colour, edgecolor="#555555")
    )
    axes.text(box.x, box.y + 0.11, box.title, ha="center", va="center", fontsize=9)
    axes.text(
        box.x, box.y - 0.17, box.folder, ha="center", va="center", fontsize=6.5, color="#444444"
    )


def _arrow(axes: Axes, tail: tuple[float, float], head: tuple[float, float]) -> None:
    axes.add_patch(
        FancyArrowPatch(tail, head, arrowstyle="-|>", mutation_scale=10, color="#333333")
    )


def _right(box: Box) -> tuple[float, float]:
    return box.x + 0.5 * box.width + 0.03, box.y


def _left(box: Box) -> tuple[float, float]:
    return box.x - 0.5 * box.width - 0.03, box.y


def _below(box: Box) -> tuple[float, float]:
    return box.x, box.y - 0.5 * HEIGHT - 0.03


def _above(box: Box) -> tuple[float, float]:
    return box.x, box.y + 0.5 * HEIGHT + 0.03


def main() -> None:
    """Draw the figure."""
    figure, axes = plt.subplots(figsize=(10.6, 8.2))
    axes.set_xlim(-0.2, 10.8)
    axes.set_ylim(0.1, 9.9)
    axes.axis("off")
    for box in BOXES:
        _draw(axes, box)
    for tail, head in (
        (SCENE, GROOM), (SCENE, FIBRE), (SCENE, LIGHT), (GROOM, TREE), (FIBRE, FEATURES),
        (LIGHT, FEATURES), (GENERATE, CLOSEST), (CLOSEST, ESCAPED), (CLOSEST, SAMPLE),
        (CLOSEST, SURFACE), (SURFACE, SHADOW),
        (SAMPLE, SHADE), (FILM, SUMS), (SUMS, IMAGE),
    ):  # fmt: skip
        _arrow(axes, _right(tail), _left(head))
    _arrow(axes, _below(SHADE), _above(SHADOW))
    # The next bounce.
    axes.plot([SHADOW.x] * 2 + [CLOSEST.x], [_below(SHADOW)[1], 3.1, 3.1], "#333333", linewidth=1.2)
    _arrow(axes, (CLOSEST.x, 3.1), _below(CLOSEST))
    axes.text(6.6, 3.18, "next bounce, while paths go on", fontsize=8, ha="center")
    for box in (FILM, LEARN):
        _arrow(axes, (box.x, _below(STATE)[1]), _above(box))
    for y, text in (
        (9.75, "once a scene, on the host"),
        (
            6.35,
            "once a wave, on the device: furcl/rendering/renderer.py, furcl/rendering/wavefront.py",
        ),
    ):
        axes.text(-0.1, y, text, fontsize=9, weight="bold", va="center")
    axes.plot([-0.1, 10.7], [6.65, 6.65], color="#999999", linewidth=0.8, linestyle=":")
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, dpi=110, bbox_inches="tight", metadata={"Software": None})


if __name__ == "__main__":
    main()
