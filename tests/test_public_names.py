"""The public names of the package."""

from __future__ import annotations

import subprocess
import sys
import types

import pytest

import furcl

MODULES = {"bcsdf", "bench", "distributed", "lights", "models", "samplers"}


@pytest.fixture(scope="module")
def kinds() -> dict[str, str]:
    """Type of every public name in a process that has imported everything else before."""
    code = """
import importlib, pkgutil, furcl
for module in pkgutil.walk_packages(furcl.__path__, "furcl."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
for name in furcl.__all__:
    print(name, type(getattr(furcl, name)).__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return dict(line.split() for line in done.stdout.splitlines())


@pytest.mark.parametrize("name", furcl.__all__)
def test_no_module_hides_a_public_name(kinds, name):
    """A subpackage called `render` would take the place of the function furcl.render."""
    assert (kinds[name] == types.ModuleType.__name__) == (name in MODULES)


def test_scenes_grooms_and_pictures_load_without_opencl(tmp_path):
    code = """
import sys, furcl
scene = furcl.load_scene("furnace")
scene.build_curves()
scene.build_light()
furcl.Image
print([name for name in ("pyopencl", "OpenEXR", "scipy") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
