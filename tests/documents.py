"""The texts of the project, and what they cite: files, names, sections, papers."""

from __future__ import annotations

import importlib
import re
import subprocess
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
FOLDERS = ("bench", "docs", "furcl", "kernels", "scenes", "tests")

_PATH = re.compile(rf"(?<![\w/.-])(?:{'|'.join(FOLDERS)})/[\w./-]*\w")
_NAME = re.compile(r"(?<![\w/.-])furcl(?:\.[A-Za-z_]\w*)+")
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_SECTION = re.compile(r"docs/(\w+\.md), ([A-Z].*)")
# "Name et al. 2015 and 2017", "Name and Name 1941", "Name, Name and Name (2006)", "Name 1997".
_AUTHOR = r"(?:d')?[A-Z][\w-]*[a-zé]"
_YEAR = r"(?:18|19|20)\d\d(?![\w.-]*\d)"
_OTHERS = rf"(?:(?:, {_AUTHOR})* and {_AUTHOR}| et al\.)?"
_PAPER = re.compile(rf"({_AUTHOR}){_OTHERS}'?,? \(?({_YEAR}(?:(?:,| and) {_YEAR})*)")


def texts(*suffixes: str) -> dict[str, str]:
    """Every committed or new file of these suffixes by its path, results of benchmarks left out."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=REPOSITORY, check=True, capture_output=True, text=True)
    names = [n for n in listed.stdout.split("\n") if n.endswith(suffixes)]
    found = {n: REPOSITORY / n for n in names if not n.startswith("bench/results/")}
    return {name: path.read_text() for name, path in found.items() if path.is_file()}


def flowing(text: str) -> str:
    """The text without line breaks, indents and the marks of comments."""
    return re.sub(r"\s*\n\s*(?:(?:\*|#|//) )?", " ", text)


def paths(text: str) -> list[str]:
    """Paths below the folders of the project."""
    return _PATH.findall(text)


def dotted_names(text: str) -> list[str]:
    """Modules of furcl and what is in them, as they are imported."""
    return _NAME.findall(text)


def exists(name: str) -> bool:
    """Whether a dotted name can be imported."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:end]))
        except ImportError:
            continue
        for part in parts[end:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def links(page: str) -> list[str]:
    """Targets of a page's links that are not in the web."""
    return [target for target in _LINK.findall(page) if "://" not in target]


def written(page: str) -> str:
    """A page without what programs put between its marks: records of what was measured."""
    return re.sub(r"<!-- (?!end).*?<!-- end -->", "", page, flags=re.S)


def headings(page: str) -> list[str]:
    """The titles of a page and its sections."""
    return re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```$", "", page, flags=re.M | re.S), re.M)


def anchor(heading: str) -> str:
    """What a link calls a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def sections(text: str) -> list[tuple[str, str]]:
    """Page, and text that begins with the title of its section: "docs/model.md, Cuticle"."""
    return _SECTION.findall(text)


def papers(text: str) -> set[tuple[str, str]]:
    """First author and year of every paper that is cited with its year."""
    found = _PAPER.findall(flowing(text))
    return {(author, year) for author, years in found for year in re.findall(r"\d{4}", years)}
