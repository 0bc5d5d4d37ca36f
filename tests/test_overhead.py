"""What numbers, plans and learning cost: renders that are compared trace the same paths."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import pytest
from scene_documents import fur_patch

if not (Path(__file__).parents[1] / "bench").is_dir():
    pytest.skip("bench/ is not in a source distribution", allow_module_level=True)

import overhead

from furcl.scene.read import with_overrides


def rays(device) -> dict[str, float]:
    """Rays of every render over those of the plain one."""
    scene = with_overrides(fur_patch(light_sampling="mis"), ["film.width=48", "film.height=32"])
    found = overhead.measure(scene, device, spp=32, rounds=1)
    assert list(found["ratios"]) == [*overhead.PARTS, overhead.ALL]
    return found["rays"]


def test_the_same_paths_are_traced(device):
    """Within 1.5 %; measured at most 0.3 %."""
    assert all(abs(ratio - 1.0) < 0.015 for ratio in rays(device).values())


def test_what_is_learned_and_planned_would_change_them(device, monkeypatch):
    """The mutant: what is worked out is used."""
    monkeypatch.setattr(overhead, "unused", nullcontext)
    found = rays(device)
    assert abs(found["learning"] - 1.0) > 0.05
    assert abs(found["allocation"] - 1.0) > 0.02


def test_percents():
    ratio = {"median": 1.031, "low": 1.02, "high": 1.0444, "n": 9}
    assert overhead.shown(ratio) == "+3.1 [+2.0, +4.4]"
    assert overhead.shown({**ratio, "low": None, "high": None}) == "+3.1"
