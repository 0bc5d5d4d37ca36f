"""furcl: a wavefront path tracer for hair and fur in OpenCL C, driven from Python.

Names are loaded when they are first used: importing furcl is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_PUBLIC = {
    "load_scene": "furcl.scene_io",
    "Scene": "furcl.scene",
    "load_curves": "furcl.groom_io",
    "save_curves": "furcl.groom_io",
    "Curves": "furcl.curves",
    "Fibre": "furcl.fibre",
    "render": "furcl.integrator",
    "Renderer": "furcl.integrator",
    "Probe": "furcl.probe",
    "Image": "furcl.image",
    "open_device": "furcl.device",
    "FurclError": "furcl.errors",
    "bcsdf": "",
    "bench": "",
    "samplers": "",
}

if TYPE_CHECKING:
    from furcl import bcsdf, bench, samplers
    from furcl.curves import Curves
    from furcl.device import open_device
    from furcl.errors import FurclError
    from furcl.fibre import Fibre
    from furcl.groom_io import load_curves, save_curves
    from furcl.image import Image
    from furcl.integrator import Renderer, render
    from furcl.probe import Probe
    from furcl.scene import Scene
    from furcl.scene_io import load_scene

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
    "load_curves",
    "load_scene",
    "open_device",
    "render",
    "samplers",
    "save_curves",
]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'furcl' has no attribute {name!r}")
    if not _PUBLIC[name]:
        return import_module(f"furcl.{name}")
    return getattr(import_module(_PUBLIC[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])
