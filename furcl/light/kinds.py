"""The kinds of light by name: those that come with furcl, and a user's own.

A kind is a subclass of `furcl.light.model.Light` in a file of its own, and a header of OpenCL C
with the functions of FUNCTIONS. A scene names it: [environment] kind = "sky".
"""

from __future__ import annotations

import msgspec

from furcl.errors import LightError
from furcl.light.constant import ConstantLight
from furcl.light.image import ImageLight
from furcl.light.model import Light
from furcl.light.sky import SkyLight
from furcl.paths import kernel_folder
from furcl.registry import Registry
from furcl.table import Table

FUNCTIONS = ("light_radiance", "light_sample", "light_density")

BUILT_IN: tuple[type[Light], ...] = (ConstantLight, SkyLight, ImageLight)
_lights: Registry[type[Light]] = Registry(
    "light", LightError, {light.kind: light for light in BUILT_IN}
)


def names() -> tuple[str, ...]:
    """All kinds that a scene can ask for, those of furcl first."""
    return _lights.names()


def find(kind: str) -> type[Light]:
    """The light of a kind.

    Raises
    ------
    LightError      unknown kind, with those that are known
    """
    return _lights.find(kind, f"light {kind!r}: known are", "furcl.lights.register")


def tables() -> dict[str, type[Table]]:
    """Kind -> type of its table in scenes."""
    return {kind: light.table for kind, light in _lights.things().items()}


def from_table(table: Table) -> Light:
    """The light that a scene's table describes; files are read here.

    Raises
    ------
    LightError      no kind has tables of this type
    FurclError      as `Light.from_table` of the kind, for example ImageError
    """
    kind = table.__struct_config__.tag
    return find(str(kind)).from_table(table)


def register(light: type[Light]) -> type[Light]:
    """Make a light of one's own usable in scenes under its kind; one of that name is replaced.

    May stand over the class as a decorator. What its header includes is sought beside it, then
    among furcl's kernels.

    Raises
    ------
    LightError      a kind of furcl's own, a table without its kind, or a header that cannot be
                    read or lacks one of the functions
    """
    kind = getattr(light, "kind", "")
    _lights.check_name(kind)
    config = light.table.__struct_config__ if issubclass(light.table, msgspec.Struct) else None
    if config is None or (config.tag_field, config.tag) != ("kind", kind):
        raise LightError(
            f"light {kind!r}: its table {light.table.__name__} is not told by its kind; declare it "
            f'as class {light.table.__name__}(Table, frozen=True, kw_only=True, tag_field="kind", '
            f'tag="{kind}")'
        )
    header = kernel_folder() / "include" / light.header
    _lights.check_header(kind, header, FUNCTIONS, "kernels/include/light/sample.clh")
    _lights.add(kind, light)
    return light


def unregister(kind: str) -> None:
    """Forget a light of one's own; LightError if there is none of that kind."""
    _lights.remove(kind)
