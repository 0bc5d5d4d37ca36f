"""The sources of grooms by name: files, the generators of furcl, and a user's own.

A scene names one: [curves] generator = "fur". A user's own is a table, a subclass of
`furcl.groom.tables.CurvesTable` whose `build` makes the curves.
"""

from __future__ import annotations

from furcl.errors import GroomError
from furcl.groom.tables import BUILT_IN, CurvesTable
from furcl.registry import Registry

_generators = Registry("generator", GroomError, BUILT_IN)


def tables() -> dict[str, type[CurvesTable]]:
    """Generator -> type of its table in scenes, those of furcl first."""
    return _generators.things()


def register(table: type[CurvesTable]) -> type[CurvesTable]:
    """Make a generator of one's own usable in scenes; one of that name is replaced.

    May stand over the class as a decorator.

    Raises
    ------
    GroomError      a name of furcl's own, or a table that is no tagged CurvesTable
    """
    # A table without a tag of its own is given its class's name.
    tagged = issubclass(table, CurvesTable) and table.__struct_config__.tag != table.__name__
    if not tagged:
        raise GroomError(
            f"{table.__name__}: is no table of a groom; declare it as class {table.__name__}"
            f'(CurvesTable, frozen=True, kw_only=True, tag="its name in scenes").'
        )
    _generators.add(str(table.__struct_config__.tag), table)
    return table


def unregister(name: str) -> None:
    """Forget a generator of one's own; GroomError if there is none of that name."""
    _generators.remove(name)
