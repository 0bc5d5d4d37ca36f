"""What pages and comments point to is there: links, files, names, sections and papers."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import count_path
import documents
import pytest
import typer

import furcl
from furcl.cli import app
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.groom.formats import suffixes

PAGES = documents.texts(".md")
TEXTS = documents.texts(".md", ".py", ".cl", ".clh", ".sh", ".toml")
SOURCES = {name: text for name, text in TEXTS.items() if name.endswith((".py", ".cl", ".clh"))}
REFERENCES = "docs/references.md"
CITING = {
    name: text
    for name, text in TEXTS.items()
    if name != REFERENCES and not name.startswith("tests/")
}


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    for link in documents.links(PAGES[page]):
        file, _, anchor = link.partition("#")
        target = documents.REPOSITORY / Path(page).parent / file if file else Path(page)
        assert (documents.REPOSITORY / target).exists(), link
        if anchor:
            titles = documents.headings((documents.REPOSITORY / target).read_text())
            assert anchor in map(documents.anchor, titles), link


@pytest.mark.parametrize("page", PAGES)
def test_files_that_a_page_names_exist(page):
    missing = [p for p in documents.paths(PAGES[page]) if not (documents.REPOSITORY / p).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES)
def test_names_that_a_page_uses_can_be_imported(page):
    assert not [n for n in documents.dotted_names(PAGES[page]) if not documents.exists(n)]


def test_files_and_names_in_comments_exist():
    """Of paths only those that name a file: a folder may be one that a program makes."""
    missing = []
    for source, text in SOURCES.items():
        # Tests make up files of their own.
        paths = [] if source.startswith("tests/") else documents.paths(text)
        files = [path for path in paths if Path(path).suffix]
        missing += [(source, f) for f in files if not (documents.REPOSITORY / f).exists()]
        names = set(documents.dotted_names(text))
        missing += [(source, name) for name in names if not documents.exists(name)]
    assert not missing


def test_sections_that_comments_cite_exist():
    titles = {Path(page).name: documents.headings(text) for page, text in PAGES.items()}
    cited = [
        (source, page, text)
        for source in SOURCES
        for page, text in documents.sections(documents.flowing(TEXTS[source]))
    ]
    assert cited
    assert not [c for c in cited if not any(c[2].startswith(t) for t in titles.get(c[1], []))]


def entries() -> dict[str, set[tuple[str, str]]]:
    """What the bibliography calls a paper, with its first author and year if it states one."""
    names = re.findall(r"^\* \*\*(.+?)\.\*\*", PAGES[REFERENCES], re.M)
    return {name: documents.papers(name) for name in names}


def test_papers_that_are_cited_are_among_the_references():
    cited = {key: name for name, text in CITING.items() for key in documents.papers(text)}
    assert len(cited) > 20
    listed = set().union(*entries().values())
    assert not {key: name for key, name in cited.items() if key not in listed}


def test_references_are_cited():
    elsewhere = " ".join(CITING.values())
    authors = {name: re.split(r",| et | and | \d", name)[0] for name in entries()}
    assert not [name for name, author in authors.items() if author not in elsewhere]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("by Yan et al. 2015 and 2017 for", {("Yan", "2015"), ("Yan", "2017")}),
        ("(d'Eon et\n# al. 2011, 2013)", {("d'Eon", "2011"), ("d'Eon", "2013")}),
        ("d'Eon, Marschner and Hanika 2014", {("d'Eon", "2014")}),
        ("by Giles' (2010) inverse", {("Giles", "2010")}),
        ("(Kahan 1965)", {("Kahan", "1965")}),
        ("Intel 2026.22 on AMD EPYC, 2 cores, 2026-11-22", set()),
    ],
)
def test_citations_are_found(text, found):
    assert documents.papers(text) == found


COMMANDS = sorted(
    {
        command
        for page in PAGES.values()
        for line in re.findall(r"^    (.+)$", documents.written(page), re.M)
        for command in re.findall(r"(?:^|/)furcl ([a-z].*)", line.partition("  #")[0])
    }
)


def parse(command: str) -> None:
    """Check names and options of a command line of furcl; files need not be there."""
    found: Any = typer.main.get_command(app)
    words = shlex.split(command)
    while hasattr(found, "commands"):
        found = found.commands[words.pop(0)]
    found.make_context("furcl", words)


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_are_understood(command):
    parse(command)


@pytest.mark.parametrize("wrong", ["bench wave x", "render x -o y --ssp 3", "compare x"])
def test_wrong_commands_are_not_understood(wrong):
    usage_error = typer.BadParameter.__base__
    assert usage_error is not None
    with pytest.raises((KeyError, usage_error)):
        parse(wrong)


def test_the_readme_names_formats_and_presets():
    readme = PAGES["README.md"]
    assert not [name for name in (*suffixes(), *Fibre.preset_names()) if f"`{name}`" not in readme]


def test_the_citation_is_of_this_version():
    citation = (documents.REPOSITORY / "CITATION.cff").read_text()
    assert f"\nversion: {furcl.__version__}\n" in citation


def test_architecture_names_what_is_in_its_files():
    """Tables with a file in the first cell and names in the second."""
    rows = re.findall(
        r"^\| `([\w/.]+)` \| ((?:`\w+`(?:, )?)+) \|", PAGES["docs/architecture.md"], re.M
    )
    assert len(rows) > 20
    missing = []
    for file, cell in rows:
        text = (documents.REPOSITORY / file).read_text()
        names = re.findall(r"\w+", cell)
        missing += [(file, name) for name in names if not re.search(rf"\b{name}\b", text)]
    assert not missing


ROOM = re.findall(
    r"^\| (an? [\w ]+) \| ((?:`[\w/.]+`(?:, )?)+) \| ((?:`[\w/.]+`(?:, )?)+) \|$",
    PAGES["docs/architecture.md"],
    re.M,
)


@pytest.mark.parametrize(("what", "own", "listed"), ROOM, ids=[what for what, _, _ in ROOM])
def test_the_page_lists_every_file_that_names_an_example(what, own, listed):
    """By its module, its header or the kind of its table; files in a folder of its own aside."""
    files = [Path(name) for name in re.findall(r"`(.+?)`", own)]
    parts = ["/".join(file.with_suffix("").parts[-2:]) for file in files]
    ways = [rf"\b{re.sub('/', '[./]', part)}\b" for part in parts]
    for folder, name in (p.split("/") for p in parts if not p.endswith(("model", "bcsdf"))):
        ways += [rf"from [\w.]*\b{folder} import .*\b{name}\b", rf'tag="{name}"']
    named = re.compile("|".join(ways))
    code = [name for name in SOURCES if name.startswith(("furcl/", "kernels/"))]
    homes = [file.parent.as_posix() for file in files if file.stem in ("model", "bcsdf")]
    naming = {
        name
        for name in code
        if named.search(SOURCES[name])
        and Path(name) not in files
        and not name.startswith(tuple(homes))
    }
    assert naming == set(re.findall(r"`(.+?)`", listed))


def test_there_is_room_for_all_that_comes():
    assert len(ROOM) == 7


def test_the_page_shows_the_layers_that_are_held():
    contracts = tomllib.loads((documents.REPOSITORY / "pyproject.toml").read_text())
    layers = contracts["tool"]["importlinter"]["contracts"][0]["layers"]
    held = [set(re.findall(r"\w+", layer)) for layer in layers if not layer.startswith("(")]
    page = PAGES["docs/architecture.md"]
    shown = re.findall(r"^    ([a-z ]+)$", page[page.index("make imports") :], re.M)
    assert [set(line.split()) for line in shown] == held


def test_the_page_counts_what_a_path_passes(device):
    """Up to a line in twenty: `make docs` counts anew."""
    found = count_path.count(device=device)
    sums = re.search(r"(\d+) files of (\d+) lines", PAGES["docs/architecture.md"])
    assert sums is not None
    assert int(sums[1]) == len(found.path)
    assert int(sums[2]) == pytest.approx(sum(found.path.values()), rel=0.05)


def test_a_path_is_short(device):
    """Near pbrt-v4's wavefront, whose utilities are not counted either: 19 files, 3,450 lines. It
    was 25 and 3,472 before several lights and materials; 27 and 3,798 with them, 28 and 3,900 with
    closed models, shared renders and the lines that leave near fields out; motion blur is 103, and
    78 are what published and simulated scattering have in common, and 50 the stack of GPUs, in a
    file with that of CPUs."""
    found = count_path.count(device=device)
    assert len(found.path) <= 29
    assert sum(found.path.values()) <= 4160
