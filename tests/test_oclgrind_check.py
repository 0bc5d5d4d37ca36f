"""The check on a simulated GPU: what its log tells, which pictures are wrong, and its scenes."""

from __future__ import annotations

from pathlib import Path

import pytest

if not (Path(__file__).parents[1] / "bench").is_dir():
    pytest.skip("bench/ is not in a source distribution", allow_module_level=True)

import oclgrind_check
import small_render

from furcl.bench.variants import VALUES
from furcl.scene.read import load_scene

# As oclgrind 21.10 says it of a kernel that races, twice, and of one that writes beyond its buffer.
RACE = """
Write-write data race at global memory address 0x1000000000000
    Kernel: racing
    \

    First entity:  Global({item},0,0) Local({item},0,0) Group(0,0,0)
      store i32 %conv, i32 addrspace(1)* %arrayidx, align 4, !dbg !29
    At line 1 (column 47) of input.cl:
      x[0] = (uint)get_global_id(0);
    \

    Second entity: Global(0,0,0) Local(0,0,0) Group(0,0,0)
      store i32 %conv, i32 addrspace(1)* %arrayidx, align 4, !dbg !29
    At line 1 (column 47) of input.cl:
      x[0] = (uint)get_global_id(0);

"""
BEYOND = """
Invalid write of size 4 at global memory address 0x1000000000100
    Kernel: beyond
    Entity: Global(63,0,0) Local(63,0,0) Group(0,0,0)
      store float 1.000000e+00, float addrspace(1)* %arrayidx, align 4, !dbg !26
    At line 7 (column 12) of core/cdf.clh:
      (source not available)
    \

"""


def test_what_a_log_tells():
    assert oclgrind_check.found_in("\n") == []
    log = RACE.format(item=1) + RACE.format(item=2) + BEYOND
    assert oclgrind_check.found_in(log) == [
        (
            "racing: Write-write data race at global memory address ..., "
            "At line 1 (column 47) of input.cl"
        ),
        (
            "beyond: Invalid write of size 4 at global memory address ..., "
            "At line 7 (column 12) of core/cdf.clh"
        ),
    ]


@pytest.mark.parametrize(
    ("changes", "right"),
    [
        ({}, True),
        ({"mean": 0.504}, True),
        ({"mean": 0.506}, False),
        ({"mean": float("nan")}, False),
        ({"hits": 0.0}, False),
    ],
)
def test_which_pictures_are_wrong(changes, right):
    report = {"hits": 1.5, "mean": 0.5, "mean_elsewhere": 0.5, **changes}
    assert (oclgrind_check.wrong_picture(report) == []) == right


@pytest.mark.parametrize("case", small_render.CASES)
def test_every_case_is_a_scene(case, tmp_path):
    (tmp_path / "tetrahedron.obj").write_text(small_render.TETRAHEDRON)
    scene, settings = small_render.CASES[case]
    overrides = [text.replace("FOLDER", str(tmp_path)) for text in settings]
    read = load_scene(scene, overrides=[*overrides, *small_render.SMALL])
    assert read.render.spp == small_render.SPP
    assert read.build_grooms().curves.n_strands <= 100


def test_values_that_no_case_has():
    every = {field: [repr(value) for value in values] for field, values in VALUES.items()}
    assert oclgrind_check.never([{"case": "a", "values": every}]) == {}
    assert oclgrind_check.never([{"case": "a", "values": {**every, "lens": ["False"]}}]) == {
        "lens": ["True"]
    }
