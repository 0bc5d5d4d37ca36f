"""furcl: a wavefront path tracer for hair and fur in OpenCL C, driven from Python.

Names are loaded when they are first used: importing furcl is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from furcl.settings import leave_out_unusable_caches

leave_out_unusable_caches()

__version__ = "0.1.0"

_PUBLIC = {
    "load_scene": "furcl.scene.read",
    "Scene": "furcl.scene.tables",
    "load_curves": "furcl.groom.formats",
    "save_curves": "furcl.groom.formats",
    "Curves": "furcl.groom.curves",
    "Fibre": "furcl.fibre.double_cylinder.parameters",
    "render": "furcl.rendering.renderer",
    "view": "furcl.viewer.show",
    "Renderer": "furcl.rendering.renderer",
    "Probe": "furcl.rendering.probe",
    "Image": "furcl.image.image",
    "open_device": "furcl.device.choice",
    "FurclError": "furcl.errors",
}
# Public names of modules.
_MODULES = {
    "lights": "furcl.light.kinds",
    "models": "furcl.fibre.model",
    "bcsdf": "furcl.fibre.double_cylinder.reference",
    "bench": "furcl.bench",
    "distributed": "furcl.distributed",
    "samplers": "furcl.samplers",
}

if TYPE_CHECKING:
    from furcl import bench, distributed, samplers
    from furcl.device.choice import open_device
    from furcl.errors import FurclError
    from furcl.fibre import model as models
    from furcl.fibre.double_cylinder import reference as bcsdf
    from furcl.fibre.double_cylinder.parameters import Fibre
    from furcl.groom.curves import Curves
    from furcl.groom.formats import load_curves, save_curves
    from furcl.image.image import Image
    from furcl.light import kinds as lights
    from furcl.rendering.probe import Probe
    from furcl.rendering.renderer import Renderer, render
    from furcl.scene.read import load_scene
    from furcl.scene.tables import Scene
    from furcl.viewer.show import view

__all__ = [
    "Curves",
    "Fibre",
    "FurclError",
    "Image",
    "Probe",
    "Renderer",
    "Scene",
    "bcsdf",
    "bench",
    "distributed",
    "lights",
    "load_curves",
    "load_scene",
    "models",
    "open_device",
    "render",
    "samplers",
    "save_curves",
    "view",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(_MODULES[name])
    if name in _PUBLIC:
        return getattr(import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'furcl' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC, *_MODULES])
