"""Committed results are JSON that names a commit of this history with nothing changed on top."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from repositories import commit, git, write

from furcl.version import code_commit

REPOSITORY = Path(__file__).parents[1]
RESULTS = "bench/results"


def files(root: Path) -> list[str]:
    """Files of results that git keeps, or that are there where it has not been asked yet."""
    listed = git(root, "ls-files", "--cached", "--others", "--exclude-standard", "--", RESULTS)
    return [name for name in listed.splitlines() if (root / name).exists()]


def wrong_commit(root: Path, name: str) -> str | None:
    """Why a commit that a file of results names is none to measure at; None if all are some."""
    found = json.loads((root / name).read_text())
    # A sweep that went on elsewhere names that of each of its runs.
    runs = found.get("runs")
    each = runs if isinstance(runs, list) else [found]
    return next((why for run in each if (why := _wrong(root, run.get("git")))), None)


def _wrong(root: Path, named: str | None) -> str | None:
    if named is None:
        return "names no commit"
    if not re.fullmatch(r"[0-9a-f]{12,40}", named):
        return f"{named}: code was changed"
    try:
        git(root, "merge-base", "--is-ancestor", named, "HEAD")
    except subprocess.CalledProcessError:
        return f"{named}: not in the history of HEAD"
    return None


@pytest.fixture
def history() -> Path:
    """This checkout, if its whole history is there."""
    if shutil.which("git") is None or not (REPOSITORY / ".git").exists():
        pytest.skip("no git, or no checkout: commits cannot be looked up")
    if git(REPOSITORY, "rev-parse", "--is-shallow-repository") == "true":
        pytest.skip("a shallow clone: older commits cannot be looked up")
    return REPOSITORY


def test_results_name_a_commit_of_the_history(history):
    found = {name: wrong_commit(history, name) for name in files(history) if name.endswith(".json")}
    wrong = [f"{name}: {why}" for name, why in found.items() if why]
    assert found
    assert not wrong, "measure anew by bench/results.sh:\n" + "\n".join(wrong)


def test_only_json_is_kept_of_results(history):
    kept = {Path(name).suffix for name in files(history) if not name.endswith(".gitignore")}
    assert kept == {".json"}


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_wrong_commits_are_seen(tmp_path):
    """The twin of the test above: every way in which a result can name a wrong commit."""
    git(tmp_path, "init", "--quiet", "--initial-branch=main")
    old = commit(tmp_path, "furcl/film.py")
    new = commit(tmp_path, "furcl/film.py")
    git(tmp_path, "checkout", "--quiet", "-b", "other")
    elsewhere = commit(tmp_path, "furcl/rendering.py")
    git(tmp_path, "checkout", "--quiet", "main")
    write(tmp_path, "furcl/film.py")
    dirty = code_commit(tmp_path)
    git(tmp_path, "checkout", "--quiet", "furcl/film.py")
    cases = {
        old: None,
        new: None,
        git(tmp_path, "rev-parse", "HEAD"): None,
        elsewhere: "not in the history",
        "0123456789ab": "not in the history",
        dirty: "code was changed",
        "main": "code was changed",
        None: "names no commit",
    }
    for named, why in cases.items():
        (tmp_path / "results.json").write_text(json.dumps({"git": named} if named else {}))
        found = wrong_commit(tmp_path, "results.json")
        assert (found is None) if why is None else why in str(found), named
