"""bench/compare_commits.py: both commits are measured, and the newer one's gain is above one."""

import json
import subprocess
import sys
from pathlib import Path

import compare_commits
import pytest

ROOT = Path(__file__).parents[1]


def test_a_commit_that_takes_half_the_time_is_twice_as_fast(capsys):
    old, new = [(2.0, 3.0)] * 6, [(1.0, 2.0)] * 6
    found = compare_commits.row("render", {"old": old, "new": new})
    assert found["seconds"] == {"old": 2.0, "new": 1.0}
    assert found["ratio"] == {"median": 2.0, "low": 2.0, "high": 2.0, "n": 6}
    assert found["cpu_ratio"]["median"] == 1.5
    assert "| 2.000 [2.000, 2.000] | 1.500 [1.500, 1.500] |" in capsys.readouterr().out


@pytest.mark.slow
def test_a_commit_beside_itself(tmp_path):
    if not (ROOT / ".git").exists():
        pytest.skip("no repository: commits cannot be checked out")
    command = ["bench/compare_commits.py", "HEAD", "HEAD", "single_fibre", "--only", "renders"]
    small = ["--only", "starts", "--size", "16x16", "--rounds", "2", "--processes", "1"]
    out = ["-o", str(tmp_path / "found.json")]
    subprocess.run([sys.executable, *command, *small, *out], cwd=ROOT, check=True)
    rows = json.loads((tmp_path / "found.json").read_text())["rows"]
    assert [row["name"] for row in rows] == ["render single_fibre", "warm start single_fibre"]
    for row in rows:
        assert min(*row["seconds"].values(), row["ratio"]["median"]) > 0.0
