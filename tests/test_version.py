"""The commit that pictures and results name is that of the code, in any state of a checkout."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from repositories import commit, git, write

from furcl.version import code_commit, software

if shutil.which("git") is None:
    pytest.skip("git is not installed", allow_module_level=True)

CODE = (
    "kernels/stages/shade.cl",
    "furcl/rendering/film.py",
    "scenes/raccoon.toml",
    "bench/peers.py",
    "bench/results.sh",
    "bench/samplers/lobe_cdf.clh",
    "pyproject.toml",
    "requirements.lock",
)
BESIDE = (
    "bench/results/stages/portable/results.json",
    "bench/results/notes.py",
    "docs/performance.md",
    "tests/test_film.py",
    "README.md",
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A repository whose last commit changed code and results."""
    git(tmp_path, "init", "--quiet", "--initial-branch=main")
    (tmp_path / ".gitignore").write_text("__pycache__/\n")
    commit(tmp_path, ".gitignore", *CODE, *BESIDE)
    return tmp_path


def head(root: Path) -> str:
    return git(root, "rev-parse", "--short=12", "HEAD")


@pytest.mark.parametrize("path", CODE)
def test_a_commit_of_code_is_named(root, path):
    assert code_commit(root) == head(root)
    first = head(root)
    second = commit(root, path)
    assert code_commit(root) == second != first


@pytest.mark.parametrize("path", BESIDE)
def test_a_commit_of_results_or_documents_is_not_named(root, path):
    first = head(root)
    assert commit(root, path) != first
    assert code_commit(root) == first


@pytest.mark.parametrize("path", [*CODE, "kernels/new.cl", "bench/new.py", "scenes/new.toml"])
@pytest.mark.parametrize("staged", [False, True])
def test_changed_and_new_code_is_dirty(root, path, staged):
    write(root, path)
    if staged:
        git(root, "add", path)
    assert code_commit(root) == f"{head(root)}-dirty"


@pytest.mark.parametrize("path", CODE)
def test_removed_code_is_dirty(root, path):
    (root / path).unlink()
    assert code_commit(root) == f"{head(root)}-dirty"


@pytest.mark.parametrize("path", [*BESIDE, "bench/results/new/results.json", "docs/new.md"])
def test_results_and_documents_make_nothing_dirty(root, path):
    write(root, path)
    write(root, "furcl/__pycache__/film.pyc")
    assert code_commit(root) == head(root)


def test_code_of_another_branch_is_named_after_the_merge(root):
    """A merge that brings code names the commit that holds all of it, the merge itself or another
    with the same code."""
    git(root, "checkout", "--quiet", "-b", "other")
    other = commit(root, "furcl/rendering/film.py")
    git(root, "checkout", "--quiet", "main")
    commit(root, "docs/performance.md")
    git(root, "merge", "--quiet", "--no-edit", "other")
    assert code_commit(root) == other
    git(root, "checkout", "--quiet", "other")
    commit(root, "scenes/raccoon.toml")
    git(root, "checkout", "--quiet", "main")
    commit(root, "kernels/stages/shade.cl")
    git(root, "merge", "--quiet", "--no-edit", "other")
    assert code_commit(root) == head(root)


def test_a_shallow_clone_names_the_oldest_commit_that_it_has(root, tmp_path_factory):
    first = head(root)
    newest = commit(root, "docs/performance.md")
    shallow = tmp_path_factory.mktemp("shallow") / "clone"
    git(root, "clone", "--quiet", "--depth=1", root.as_uri(), str(shallow))
    assert code_commit(shallow) == newest != first


def test_a_worktree_is_a_checkout_too(root, tmp_path_factory):
    first = head(root)
    tree = tmp_path_factory.mktemp("worktree") / "tree"
    git(root, "worktree", "add", "--quiet", str(tree), "HEAD")
    assert (tree / ".git").is_file()
    assert code_commit(tree) == first


def test_a_hook_of_another_repository_does_not_mislead(root, monkeypatch):
    monkeypatch.setenv("GIT_DIR", "/nonexistent/.git")
    monkeypatch.setenv("GIT_INDEX_FILE", "/nonexistent/index")
    assert code_commit(root) == head(root)


def test_no_commit_without_a_checkout(tmp_path, monkeypatch):
    assert code_commit(tmp_path) is None
    git(tmp_path, "init", "--quiet")
    assert code_commit(tmp_path) is None
    commit(tmp_path, "README.md")
    write(tmp_path, "furcl/film.py")
    assert code_commit(tmp_path) is None
    assert code_commit(tmp_path / "furcl") is None
    commit(tmp_path, "furcl/film.py")
    assert code_commit(tmp_path) == head(tmp_path)
    monkeypatch.setenv("PATH", "/nonexistent")
    assert code_commit(tmp_path) is None


def test_software_is_a_version_and_a_commit():
    found = software()
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*|not installed", found["version"])
    assert found.get("git") == code_commit(Path(__file__).parents[1])
