"""furcl as one of the renderers of bench/peers.py."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from peer_worker import Render, Task, serve

from furcl.device.choice import open_device
from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene


def prepare(task: Task, folder: Path) -> tuple[Render, dict[str, Any]]:
    """A renderer that starts again for every picture."""
    size, lamp, fibre = task["size"], task["lamp"], task["fibre"]
    same = {
        "max_depth": task["bounces"],
        "roulette": "depth",
        "roulette_depth": task["bounces"],
        "light_sampling": "mis",
        "sequence": "independent",
    }
    scene = decode_scene(
        {
            "name": task["groom"],
            "film": {"width": size, "height": size, "filter": "box"},
            "camera": task["camera"],
            "environment": {"kind": "constant", "radiance": task["environment"]},
            "lamp": {
                "key": {
                    "kind": "quad",
                    "position": lamp["position"],
                    "target": lamp["target"],
                    "size": [lamp["size"], lamp["size"]],
                    "radiance": lamp["radiance"],
                }
            },
            "mesh": {
                "scalp": {
                    "file": str(folder / "scalp.ply"),
                    "albedo": task["scalp_albedo"],
                    "smooth": False,
                }
            },
            "fibre": {"model": "chiang", "mode": task.get("mode", "far"), **fibre},
            "curves": {"generator": "file", "file": str(folder / "groom.npz")},
            "render": same if task["same_settings"] else {},
        },
        task["groom"],
    )
    device = open_device(task["device"])
    renderer = Renderer(scene, device)

    def render(seed: int, spp: int) -> Any:
        renderer.restart(seed)
        renderer.advance(spp)
        return renderer.image().rgb

    return render, {"version": f"furcl on {device.name}, {device.platform}"}


if __name__ == "__main__":
    serve(prepare)
