"""Short forms of bench/faults/geometry.py, and what would bring each fault back."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from faults import geometry

from furcl.bvh import partition
from furcl.device import source
from furcl.groom import curves as curves_module

CASES = {case.name: case for case in geometry.CASES}
BLOCK, TREE, CURVE = "bvh/block.clh", "bvh/binary_tree.clh", "geometry/curve.clh"
# What is replaced by what in which file, and the case that sees it.
# Of the whole groom's size, added to the rounding that blocks allow for.
SLACK = (
    "tv->ray.slack = 4e-4f * as_float(groom->blocks[FURCL_BLOCK_STEP]); "
    "__global const uint* block = block_at(groom, tv->next);"
)
MUTANTS = {
    "rounding of the whole groom": (
        "one stray point slows all rays",
        (BLOCK, "float4 x, y, z; ", "float slack; float4 x, y, z; "),
        (BLOCK, "float slack = 1.5e-6f * (", "float slack = ray->slack + 1.5e-6f * ("),
        (
            "bvh/traversal.clh", "    __global const uint* block = block_at(groom, tv->next);",
            SLACK,
        ),
    ),
    "small nodes are opened": (
        "one stray point slows all rays", (TREE, "24.0f / 255.0f", "0.0f"),
    ),
    "boxes relative to the origin": (
        "a groom far from the origin",
        (TREE, "{lower - FLT_EPSILON * (fabs(lower) + fabs(shift)),",
         "{lower - FLT_EPSILON * fabs(to),"),
    ),
    "the whole strand is left": (
        "light leaks through a strand beside itself",
        (CURVE, "meets_ball(query, vertex_at_time(groom->vertices, last + 1u, time)) && ", ""),
    ),
    "the way along the strand does not end": (
        "a long strand costs by its points",
        (CURVE, "meets_ball(query, vertex_at_time(groom->vertices, last + 1u, time)) && ", ""),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_is_over(name, device, tmp_path):
    assert CASES[name].run(tmp_path, True)


@pytest.mark.parametrize("mutant", MUTANTS)
def test_a_mutant_brings_it_back(mutant, device, tmp_path, monkeypatch):
    name, *replacements = MUTANTS[mutant]
    shutil.copytree(source.kernel_folder(), tmp_path / "kernels")
    for file, right, wrong in replacements:
        path = tmp_path / "kernels/include" / file
        text = path.read_text()
        assert text.count(right) == 1
        path.write_text(text.replace(right, wrong))
    monkeypatch.setattr(source, "kernel_folder", lambda: tmp_path / "kernels")
    with pytest.raises(AssertionError):
        CASES[name].run(Path(tmp_path), True)


@pytest.mark.parametrize("part", ["without_short_segments", "copied_strands"])
def test_without_cleaning_it_comes_back(part, device, tmp_path, monkeypatch):
    nothing = np.zeros(0, np.int64) if part == "copied_strands" else None
    monkeypatch.setattr(curves_module, part, lambda *_: nothing)
    name = "a groom merged with itself is darker"
    name = "copies of points paint discs" if nothing is None else name
    with pytest.raises(AssertionError):
        CASES[name].run(tmp_path, True)


def test_without_a_chunk_for_strays_it_comes_back(device, tmp_path, monkeypatch):
    everywhere = np.array([[-np.inf] * 3, [np.inf] * 3], np.float32)
    monkeypatch.setattr(partition, "_surroundings", lambda *_: everywhere)
    with pytest.raises(AssertionError):
        CASES["one stray point of a large groom"].run(tmp_path, True)
