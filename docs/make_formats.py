"""Writes docs/formats.md from what the readers of grooms say: python docs/make_formats.py."""

from __future__ import annotations

from pathlib import Path

from furcl.groom.flatten import TOLERANCE
from furcl.groom.formats import FORMATS, NOT_READ
from furcl.groom.formats.format import Format

PAGE = Path(__file__).with_name("formats.md")
INTRODUCTION = f"""# Groom formats

*Written by `make docs` from the readers.*

A file's suffix says its format. `furcl info FILE` says what is in it, `furcl convert FILE OTHER`
writes it in another one, `furcl render FILE -o out.exr` makes a picture.

* Strands go root to tip. Radii are radii: where a format has widths, they are halved.
* Lengths are those of the file. `--scale S` multiplies all of them, `--radius-scale S` the radii,
  `--default-radius R` is for files without any.
* z is up. A file that says that y is up is turned; of others `--up y` says it (`up_axis` in
  scenes). The turn swaps and negates coordinates and is exact.
* Cubic curves become polylines, with points only where they bend: nowhere farther from the curve
  than {TOLERANCE}.
* What is written and read again has the same bits, where the format has a place for it; what has
  none is named in the log.
* Text is read block by block, and arrays go from the file into the groom.
* Whatever cannot be read is refused with the file, the place and a remedy.
"""


def page() -> str:
    """The text of docs/formats.md."""
    table = ["| format | suffixes | | |", "|---|---|---|---|"]
    table += [
        f"| {form.name} | {_suffixes(form)} | {'read and written' if form.write else 'read'} | "
        f"{f'needs furcl[{form.extra}]' if form.extra else ''} |"
        for form in FORMATS
    ]
    parts = [INTRODUCTION, "\n".join(table) + "\n", *map(_section, FORMATS)]
    refused = [f"| `{suffix}` | {why} |" for suffix, why in NOT_READ.items()]
    parts.append("## Not read\n\n" + "\n".join(["| suffix | what to do |", "|---|---|", *refused]))
    return "\n".join(parts) + "\n"


def _suffixes(form: Format) -> str:
    return ", ".join(f"`{suffix}`" for suffix in form.suffixes)


def _section(form: Format) -> str:
    rows = [
        ("strands", form.points),
        ("radius", form.radius),
        ("units, axes", form.units),
        ("values", form.kept),
        ("not read", form.left_out),
    ]
    lines = [f"## {form.name}", "", form.about, "", "| | |", "|---|---|"]
    return "\n".join([*lines, *(f"| {name} | {text} |" for name, text in rows if text)]) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
