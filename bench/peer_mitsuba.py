"""Mitsuba 3 as one of the renderers of bench/peers.py; needs mitsuba alone.

Task: `variant`, such as scalar_rgb or llvm_ad_rgb, and `shape`, bsplinecurve or linearcurve. A
linearcurve has no tangent: its fibres scatter in frames that lie anyhow.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from peer_worker import Render, Task, serve


def prepare(task: Task, folder: Path) -> tuple[Render, dict[str, Any]]:
    """The scene, in Mitsuba's terms."""
    import mitsuba as mi

    mi.set_variant(task["variant"])
    splines = task["shape"] == "bsplinecurve"
    curves = folder / f"{task['variant']}-{task['shape']}.txt"
    _write_curves(curves, np.load(folder / ("control.npz" if splines else "groom.npz")))
    camera, lamp, fibre = task["camera"], task["lamp"], task["fibre"]
    look_at = mi.ScalarTransform4f().look_at
    integrator: dict[str, Any] = {"type": "path"}
    if task["same_settings"]:
        # Its depth counts the camera ray, and what lies beyond it never ends at random.
        integrator |= {"max_depth": task["bounces"] + 1, "rr_depth": 1 << 20}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": integrator,
            "sensor": {
                "type": "perspective",
                "fov": camera["vfov_deg"],
                "fov_axis": "y",
                "to_world": look_at(
                    origin=camera["origin"], target=camera["target"], up=camera["up"]
                ),
                "film": {
                    "type": "hdrfilm",
                    "width": task["size"],
                    "height": task["size"],
                    "pixel_format": "rgb",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "independent"},
            },
            "environment": {
                "type": "constant",
                "radiance": {"type": "rgb", "value": task["environment"]},
            },
            "lamp": {
                "type": "rectangle",
                "to_world": look_at(
                    origin=lamp["position"], target=lamp["target"], up=[0.0, 0.0, 1.0]
                )
                @ mi.ScalarTransform4f().scale(0.5 * lamp["size"]),
                "emitter": {
                    "type": "area",
                    "radiance": {"type": "rgb", "value": [lamp["radiance"]] * 3},
                },
            },
            "scalp": {
                "type": "ply",
                "filename": str(folder / "scalp.ply"),
                "face_normals": True,
                "bsdf": {
                    "type": "twosided",
                    "nested": {
                        "type": "diffuse",
                        "reflectance": {"type": "rgb", "value": task["scalp_albedo"]},
                    },
                },
            },
            "hair": {
                "type": task["shape"],
                "filename": str(curves),
                "bsdf": {
                    "type": "hair",
                    "sigma_a": {"type": "rgb", "value": fibre["sigma_a"]},
                    "longitudinal_roughness": fibre["beta_m"],
                    "azimuthal_roughness": fibre["beta_n"],
                    # Its R goes to the tip, the others' to the root.
                    "scale_tilt": -fibre["alpha_deg"],
                    "int_ior": fibre["eta"],
                    "ext_ior": 1.0,
                },
            },
        }
    )

    def render(seed: int, spp: int) -> Any:
        return np.array(mi.render(scene, seed=seed, spp=spp))

    return render, {"version": f"Mitsuba {mi.__version__} {task['variant']}, {task['shape']}"}


def _write_curves(path: Path, groom: Any) -> None:
    """x y z radius a line, a blank line between strands."""
    rows = np.column_stack([groom["points"], groom["radii"]])
    with path.open("w", encoding="ascii") as file:
        for first, end in zip(groom["offsets"], groom["offsets"][1:], strict=False):
            np.savetxt(file, rows[first:end], fmt="%.9g")
            file.write("\n")


if __name__ == "__main__":
    serve(prepare)
