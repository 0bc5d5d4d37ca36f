"""Changes in the live view leave nothing behind: a short run of bench/view_soak.py."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

if not (Path(__file__).parents[1] / "bench").is_dir():
    pytest.skip("bench/ is not in a source distribution", allow_module_level=True)

import view_latency
import view_soak

from furcl.scene.read import load_scene

SCENE = load_scene("black_hair", overrides=["curves.n_strands=50"], size="16x16")
#: One of each kind a tenth.
CHANGES = 10 * len(view_latency.CHANGES)
ROW = (200.0, 5.0, 3.0, 7.0, 0.0, 10.0)


@pytest.mark.slow
def test_changes_leave_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    rows = list(view_soak.soaked(SCENE, CHANGES, None))
    assert len(rows) == 11
    # That of the process settles after a few hundred changes, longer than a test should take.
    assert set(view_soak.grown(rows)) <= {"memory MiB"}


@pytest.mark.parametrize(
    ("column", "more", "found"),
    [
        (0, 5.0, ["memory MiB"]),
        (0, 0.5, []),
        (1, 0.1, ["device MiB"]),
        (2, 1.0, ["threads"]),
        (3, 1.0, ["open files"]),
        (4, 1.0, ["temporary"]),
        (5, 30.0, []),
    ],
)
def test_what_grows_is_seen(column: int, more: float, found: list[str]) -> None:
    rows = [
        tuple(value + (more * i if at == column else 0.0) for at, value in enumerate(ROW))
        for i in range(11)
    ]
    assert view_soak.grown(rows) == found
