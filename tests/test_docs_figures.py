"""Figures in the pages: each says where it comes from, for readers to print it again."""

from __future__ import annotations

import re

import pytest
from documents import texts

# Pages without measurements: keys and formats as the code describes them, papers, a diary that
# says of itself which of its forms are gone, and what `bash bench/faults.sh` has written.
GENERATED = {"docs/scene.md", "docs/formats.md", "docs/faults_run.md"}
OTHERS = {"docs/references.md", "docs/notebook.md", "docs/dependencies.md"}
PAGES = {
    name: text
    for name, text in texts(".md").items()
    if (name.startswith("docs/") or name == "README.md") and name not in GENERATED | OTHERS
}

# What is chosen or defined, not measured, in sections that name no command.
CHOSEN = {
    ("README.md", "Install"): {"0.3"},
    ("docs/layers.md", "Cryptomatte"): {"1.2"},
    ("docs/results.md", "Error against run time: the paper's experiments"): {"95 %"},
    (
        "docs/results.md",
        "The ladder: from a conventional renderer to the same error in less time",
    ): {"0.27"},
    ("docs/allocation.md", "The rule"): {"1.5"},
    ("docs/allocation.md", "The error that was reached"): {"95 %"},
    ("docs/convergence.md", "What is measured"): {"95 %"},
    ("docs/model.md", "Longitudinal"): {"0.001"},
    ("docs/motion.md", "Motion blur"): {"0.25"},
    ("docs/oracle.md", "What each value is"): {"0.5"},
    ("docs/roulette.md", "Russian roulette"): {"0.3"},
}

_BLOCK = re.compile(r"```.*?```|<!-- [\w-]+ -->.*?<!-- end -->", re.DOTALL)
_HEADING = re.compile(r"^#+ +(.*)$", re.MULTILINE)
_FIGURE = re.compile(r"(?<![\w.,/-])\d+\.\d+(?![\w.])(?: %)?|(?<![\w.])\d+ %")
_SOURCE = re.compile(
    r"`(?:python |furcl |bash |make )[^`]+`|^ {4}(?:python|furcl|bash) |tests/test_\w+\.py"
    r"|\*?\*?\[[NT]\]|(?:table|tables|section|equation|figure) \d",
    re.MULTILINE | re.IGNORECASE,
)


def sections(text: str) -> list[tuple[str, str]]:
    """Heading and text of each section, without blocks of code and what commands have written."""
    text = _BLOCK.sub("", text)
    starts = [*_HEADING.finditer(text)]
    ends = [match.start() for match in starts[1:]] + [len(text)]
    return [(m.group(1), text[m.end() : end]) for m, end in zip(starts, ends, strict=True)]


def without_source(page: str, text: str) -> list[tuple[str, set[str]]]:
    """Sections with figures that are in no table of the page that a command has written, and that
    name no command, test or place in a paper; these figures."""
    written = {figure for block in _BLOCK.findall(text) for figure in _FIGURE.findall(block)}
    found = []
    for heading, section in sections(text):
        chosen = CHOSEN.get((page, heading), set())
        figures = set(_FIGURE.findall(section)) - chosen - written
        if figures and not _SOURCE.search(section):
            found.append((heading, figures))
    return found


@pytest.mark.parametrize("page", PAGES)
def test_figures_carry_their_source(page):
    """A command that prints them, a test that holds them, a table that a command has written, or
    the paper's table that they are of."""
    assert without_source(page, PAGES[page]) == []


def test_chosen_figures_are_there():
    """None is left on the list that its section does not have any more."""
    for (page, heading), figures in CHOSEN.items():
        (text,) = (text for name, text in sections(PAGES[page]) if name == heading)
        assert figures <= set(_FIGURE.findall(text)), (page, heading)


@pytest.mark.parametrize(
    ("text", "figures"),
    [
        ("## Gain\n<!-- a -->\n| 0.930 |\n<!-- end -->\n0.930 of it.", None),
        ("## Gain\n<!-- a -->\n| 0.935 |\n<!-- end -->\n0.930 of it.", {"0.930"}),
        ("## Gain\nIt is 1.31 times as fast.", {"1.31"}),
        ("## Gain\nIt takes 12 % less, in `furcl/a.py` too.", {"12 %"}),
        ("## Gain\nIt is 1.31 times as fast.\n## Rule\nSee `python bench/x.py`.", {"1.31"}),
        ("## Gain\n<!-- a -->\n| 3.5 |\n<!-- end -->\nand 2.5 x.", {"2.5"}),
        ("## Gain\n`python bench/x.py` prints 1.31.", None),
        ("## Gain\n1.31 (`tests/test_x.py`).", None),
        ("## Gain\nTable 5 of the paper has 0.0343.", None),
        ("## Gain\n<!-- a -->\n| 3.5 |\n<!-- end -->", None),
        ("## Gain\nVersion 3.1.2, OpenCL 2, beta_m of 1e-3.", None),
    ],
)
def test_figures_without_a_source_are_seen(text, figures):
    found = without_source("docs/x.md", text)
    assert found == ([] if figures is None else [("Gain", figures)])
