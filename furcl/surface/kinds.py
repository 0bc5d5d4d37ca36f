"""The kinds of surface by name: those that come with furcl, and a user's own.

A kind is a table of its own, a subclass of `furcl.surface.model.Surface`, and a header of OpenCL C
that defines surface_hit and surface_point. A scene names it: [body] kind = "ellipsoid".
"""

from __future__ import annotations

from furcl.errors import SceneError
from furcl.paths import kernel_folder
from furcl.registry import Registry
from furcl.surface.ellipsoid import NOWHERE, Body
from furcl.surface.model import Surface

FUNCTIONS = ("surface_hit", "surface_point")

BUILT_IN: tuple[type[Surface], ...] = (Body,)
_surfaces: Registry[type[Surface]] = Registry(
    "surface", SceneError, {surface.part.name: surface for surface in BUILT_IN}
)

#: A surface that no ray meets, for kernels with code for one and a scene without.
ABSENT: Surface = NOWHERE


def tables() -> dict[str, type[Surface]]:
    """Kind -> type of its table in scenes."""
    return _surfaces.things()


def register(surface: type[Surface]) -> type[Surface]:
    """Make a surface of one's own usable in scenes under the name of its part; one of that name is
    replaced. May stand over the class as a decorator.

    Raises
    ------
    SceneError      a kind of furcl's own, a table that is tagged otherwise, or a header that cannot
                    be read or lacks one of the functions
    """
    name = surface.part.name
    _surfaces.check_name(name)
    config = surface.__struct_config__
    if (config.tag_field, config.tag) != ("kind", name):
        raise SceneError(
            f"surface {name!r}: its table is tagged {config.tag_field} = {config.tag!r}; give the "
            f"class tag_field='kind', tag={name!r}"
        )
    header = kernel_folder() / "include" / surface.part.header
    _surfaces.check_header(name, header, FUNCTIONS, "kernels/include/surface/ellipsoid.clh")
    _surfaces.add(name, surface)
    return surface


def unregister(name: str) -> None:
    """Forget a surface of one's own; SceneError if there is none of that name."""
    _surfaces.remove(name)
