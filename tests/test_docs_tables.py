"""The tables of docs/ are those that bench/results and the presets give."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

if not (Path(__file__).parents[1] / "bench").is_dir():
    pytest.skip("bench/ is not in a source distribution", allow_module_level=True)

import docs_tables
import tables

SAME = {
    "git": "0123456789ab",
    "date": "2026-11-22",
    "machine": {"processor": "a processor", "cores": 2},
    "device": {"platform": "Portable Computing Language OpenCL 3.0", "driver": "3.1+debian"},
}


@pytest.mark.parametrize("name", docs_tables.DOCUMENTS)
def test_documents_hold_their_tables(name):
    assert docs_tables.written(name) == (docs_tables.DOCS / name).read_text(), (
        f"docs/{name} is not what python bench/docs_tables.py writes"
    )


def test_every_mark_has_a_table():
    for path in docs_tables.DOCS.glob("*.md"):
        marks = set(re.findall(r"<!-- (\S+) -->", path.read_text())) - {"end"}
        assert marks <= set(docs_tables.DOCUMENTS.get(path.name, {})), path.name


def test_a_table_is_put_between_its_marks():
    text = "a\n<!-- one -->\nold | table\n<!-- end -->\nb\n<!-- two -->\n<!-- end -->\nc\n"
    found = tables.filled(text, {"one": lambda: r"new \1 table", "two": lambda: "2"})
    one, two = "<!-- one -->\n\nnew \\1 table\n\n<!-- end -->", "<!-- two -->\n\n2\n\n<!-- end -->"
    assert found == f"a\n{one}\nb\n{two}\nc\n"


@pytest.mark.parametrize("text", ["", 2 * "<!-- one -->\n<!-- end -->\n", "<!-- one -->\n"])
def test_marks_are_there_once(text):
    with pytest.raises(ValueError, match=r"<!-- one --> \.\.\. <!-- end --> is there"):
        tables.filled(text, {"one": str})


def test_runs_of_the_same_circumstances_share_a_line():
    found = tables.circumstances(
        {**SAME, "command": "first"},
        {**SAME, "command": "other", "git": "ba9876543210"},
        {**SAME, "command": "second"},
    )
    assert found == (
        "PoCL 3.1 on a processor, 2 cores, 2026-11-22, commit 0123456789ab:\n\n"
        "    first\n    second\n\n"
        "PoCL 3.1 on a processor, 2 cores, 2026-11-22, commit ba9876543210:\n\n    other"
    )
