"""Kernels built for GPUs that are not there: what compilers say, which kernels, which bars."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

if not (Path(__file__).parents[1] / "bench").is_dir():
    pytest.skip("bench/ is not in a source distribution", allow_module_level=True)

import gpu_check
from gpu_compilers import CompileError, Use, amd_uses, ptxas_uses

from furcl.bench.variants import VALUES, covering, pairwise, reachable
from furcl.paths import kernel_folder

# As ptxas 13.0 says it, of two kernels, the second with a function that it calls.
PTXAS = """\
ptxas info    : 0 bytes gmem
ptxas info    : Compiling entry function 'shade' for 'sm_75'
ptxas info    : Function properties for shade
    40 bytes stack frame, 0 bytes spill stores, 0 bytes spill loads
ptxas info    : Used 168 registers, used 0 barriers, 40 bytes cumulative stack size
ptxas info    : Compile time = 3823.185 ms
ptxas info    : Compiling entry function 'sample_lobe_h' for 'sm_75'
ptxas info    : Function properties for sample_lobe_h
    16 bytes stack frame, 8 bytes spill stores, 12 bytes spill loads
ptxas info    : Used 54 registers, used 0 barriers, 472 bytes cmem[0]
ptxas info    : Compile time = 337.751 ms
ptxas info    : Function properties for values_at_offset
    24 bytes stack frame, 4 bytes spill stores, 0 bytes spill loads
"""

# As clang 19 ends AMD's assembly, shortened: arguments have names too.
AMD = """\
	.amdgpu_metadata
---
amdhsa.kernels:
  - .agpr_count:     0
    .args:
      - .address_space:  global
        .name:           state
        .offset:         0
        .size:           8
    .kernarg_segment_size: 184
    .name:           intersect_closest
    .private_segment_fixed_size: 1156
    .sgpr_count:     60
    .sgpr_spill_count: 0
    .symbol:         intersect_closest.kd
    .vgpr_count:     140
    .vgpr_spill_count: 0
  - .agpr_count:     0
    .name:           intersect_shadow
    .private_segment_fixed_size: 1160
    .sgpr_count:     49
    .sgpr_spill_count: 2
    .vgpr_count:     138
    .vgpr_spill_count: 3
amdhsa.target:   amdgcn-amd-amdhsa--gfx1100
...
	.end_amdgpu_metadata
"""


def test_what_ptxas_says():
    assert ptxas_uses(PTXAS) == {"shade": Use(168, 0, 40, 0), "sample_lobe_h": Use(54, 0, 16, 24)}


def test_what_amds_assembly_says():
    assert amd_uses(AMD) == {
        "intersect_closest": Use(140, 60, 1156, 0),
        "intersect_shadow": Use(138, 49, 1160, 3),
    }


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (ptxas_uses, ""),
        (ptxas_uses, PTXAS.replace("Used 54", "Took 54")),
        (amd_uses, "\t.text\n"),
        (amd_uses, AMD.replace(".vgpr_spill_count: 3", "")),
    ],
)
def test_what_is_not_understood_is_an_error(read, said):
    with pytest.raises(CompileError):
        read(said)


def test_every_value_and_every_kernel_of_a_render_is_there():
    rows = covering(pairwise(VALUES, reachable)[0])
    for name, values in VALUES.items():
        assert {str(row[name]) for row in rows} == {str(value) for value in values}, name
    built = {kernel for _, _, kernels, _ in gpu_check.programs(rows) for kernel in kernels}
    stages = (kernel_folder() / "stages").glob("*.cl")
    texts = "".join(path.read_text() for path in stages)
    assert built == set(re.findall(r"__kernel void (\w+)", texts))
    assert len(built) >= 11


def test_texts_are_those_of_a_gpu():
    """One ray and one path an item, no lanes."""
    rows = covering(pairwise(VALUES, reachable)[0])[:1]
    texts = "".join(text for *_, text in gpu_check.programs(rows))
    found = dict(re.findall(r"#define FURCL_(LANES|RAYS_\w+|PATHS_PER_ITEM) (\d+)", texts))
    assert found == {
        "LANES": "1", "PATHS_PER_ITEM": "1", "RAYS_PER_ITEM": "1", "RAYS_IN_FLIGHT": "1",
    }  # fmt: skip


def use(**changes):
    """Of a kernel within all bars."""
    return {
        "kernel": "shade", "evaluates": False, "target": "sm_90", "registers": 96,
        "scalars": 0, "stack": 0, "spills": 0, **changes,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "holds"),
    [
        ({}, True),
        ({"spills": 1}, False),
        ({"registers": 97}, False),
        ({"registers": 168, "evaluates": True}, True),
        ({"registers": 120, "target": "gfx90a"}, True),
        ({"stack": 513}, True),
        ({"kernel": "intersect_closest", "registers": 128, "stack": 512}, True),
        ({"kernel": "intersect_shadow", "stack": 513}, False),
    ],
)
def test_bars(changes, holds):
    assert (gpu_check.broken([use(**changes)]) == []) == holds


def test_the_most_of_all_variants_counts():
    found = gpu_check.most(
        [use(registers=80, stack=8), use(registers=70, stack=16), use(kernel="learn")]
    )
    assert [(row["variants"], row["registers"], row["stack"]) for row in found] == [
        (2, 80, 16),
        (1, 96, 0),
    ]
