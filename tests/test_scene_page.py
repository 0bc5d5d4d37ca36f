"""docs/scene.md: every key of a scene is there, means something, and has the range that holds."""

from __future__ import annotations

import tomllib
from typing import Annotated, Any

import make_scene
import pytest
from msgspec import Meta
from scene_documents import MINIMAL

from furcl.errors import SceneError
from furcl.scene.overrides import apply_overrides
from furcl.scene.read import decode_scene
from furcl.scene.schema import files_in
from furcl.table import Table

# While nothing but furcl's own kinds is registered.
PAGE = make_scene.page()
SECTIONS = {section.heading: section for section in make_scene.sections()}
RANGES = [
    (section, key)
    for section in SECTIONS.values()
    for key in make_scene.keys(section.struct)
    if key.limits and not section.of_list  # whose keys cannot be set one by one
]


# What examples call a thing of which a scene may have several.
NAMES = {"groom": "scalp", "lamp": "key", "mesh": "head"}


def path(section: make_scene.Section) -> list[str]:
    """The keys that lead to a section's table in its example."""
    outer = section.name.split(".")
    return [NAMES[outer[0]] if key == "NAME" else key for key in outer]


def document(section: make_scene.Section, tmp_path) -> dict[str, Any]:
    """A scene with the section's example; files that it names are there."""
    tables = {**MINIMAL, **tomllib.loads(section.example)}
    if section.name == "fibre.melanin":
        tables["fibre"] = {"preset": "human-white", **tables["fibre"]}
    if section.name.startswith("groom"):
        del tables["curves"]
        scalp = tables["groom"].setdefault("scalp", {})
        scalp.setdefault("curves", MINIMAL["curves"])
    if section.name.startswith("mesh"):
        tables["mesh"].setdefault("head", {}).setdefault("file", "head.obj")
    for keys, table in files_in(tables):
        (tmp_path / table[keys[-1]]).write_bytes(b" ")
        table[keys[-1]] = str(tmp_path / table[keys[-1]])
    return tables


def test_the_page_is_that_of_the_tables():
    assert make_scene.PAGE.read_text() == PAGE, "run `make docs`"


@pytest.mark.parametrize("heading", SECTIONS)
def test_examples_are_scenes(heading, tmp_path):
    section = SECTIONS[heading]
    outermost, *keys = path(section)
    assert outermost in tomllib.loads(section.example)
    table = getattr(decode_scene(document(section, tmp_path)), outermost)
    for key in keys:
        table = table[key] if isinstance(table, dict) else getattr(table, key)
    table = table[0] if section.of_list else table
    assert isinstance(table, section.struct)


@pytest.mark.parametrize(("section", "key"), RANGES, ids=lambda x: getattr(x, "name", ""))
def test_ranges_are_those_that_hold(section, key, tmp_path):
    low, high = key.limits
    given = document(section, tmp_path)
    # A camera is placed by hand or framed; a colour is given in one way.
    if section.name == "camera":
        given["camera"] = {"target": [1, 0, 0]} if key.name == "origin" else {}
    if section.name == "fibre":
        given["fibre"] = {"preset": "raccoon"}
    for beyond in (low - 1.0 - abs(low), high + 1.0 + abs(high)):
        beyond = int(beyond) if key.kind.startswith("whole") else beyond
        value = [beyond] * int(key.kind[0]) if key.kind[0].isdigit() else beyond
        changed = apply_overrides(given, [f"{'.'.join(path(section))}.{key.name}={value}"])
        with pytest.raises(SceneError, match=key.name):
            decode_scene(changed)


def test_what_docstrings_say_is_found():
    class Whole(Table, frozen=True):
        """A table.

        Attributes
        ----------
        a, b : float    the first
                        and the second, 0 .. 2 [m / s]
        c : (n,)        uniform in [1 - v, 1]
        """

        a: Annotated[float, Meta(ge=0.0, le=2.0)] = 1.0
        b: Annotated[float, Meta(ge=0.0, le=2.0)] = 1.0
        c: int | None = None

    a, b, c = make_scene.keys(Whole)
    assert (a.meaning, a.unit, a.limits, a.range) == (
        "the first and the second", "m / s", (0.0, 2.0), "0 to 2"
    )  # fmt: skip
    assert (b.name, b.default, c.meaning, c.unit) == ("b", "`1`", "uniform in [1 - v, 1]", "")


def test_a_key_without_a_meaning_is_refused():
    class Mute(Table, frozen=True):
        """A table.

        Attributes
        ----------
        a : int     the first
        """

        a: int = 1
        b: int = 2

    with pytest.raises(ValueError, match=r"Mute\.b has no meaning"):
        make_scene.keys(Mute)


def test_a_range_that_does_not_hold_is_refused():
    class Wrong(Table, frozen=True):
        """A table.

        Attributes
        ----------
        a : int     the first, 1 .. 9
        """

        a: Annotated[int, Meta(ge=1, le=8)] = 1

    with pytest.raises(ValueError, match=r"Wrong\.a: its docstring states the range \(1.0, 9.0\)"):
        make_scene.keys(Wrong)
