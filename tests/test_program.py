"""Kernel texts: includes, defines, builds, and that no build is ever stale."""

import shutil

import numpy as np
import pyopencl as cl
import pytest

from furcl.device import layout, program
from furcl.device.features import Features
from furcl.device.memory import Memory
from furcl.errors import KernelBuildError, LayoutError, ResourceError

KERNELS = (
    "stages/generate.cl",
    "stages/intersect.cl",
    "stages/sample_lobe_h.cl",
    "stages/shade.cl",
    "stages/film.cl",
    "prepare/tables.cl",
    "tools/probe.cl",
)


@pytest.fixture
def kernel_copy(tmp_path, monkeypatch):
    """A copy of the kernels that a test may edit."""
    folder = tmp_path / "kernels"
    shutil.copytree(program.kernel_folder(), folder)
    monkeypatch.setattr(program, "kernel_folder", lambda: folder)
    return folder


def _write_constant(folder, value):
    (folder / "include" / "constant.clh").write_text(f"#define VALUE {value}\n")
    (folder / "constant.cl").write_text(
        '#include "core/prelude.clh"\n#include "constant.clh"\n'
        "__kernel void constant_value(__global float* out) { out[0] = VALUE; }\n"
    )


def _run_constant(device):
    kernel = cl.Kernel(program.build(device, "constant.cl", Features()), "constant_value")
    memory = Memory(device)
    out = memory.allocate("out", 16)
    kernel(device.queue, (1,), (1,), out)
    return float(memory.read(out, 1)[0])


def test_edited_include_is_never_stale(device, kernel_copy):
    _write_constant(kernel_copy, "1.0f")
    assert _run_constant(device) == 1.0
    _write_constant(kernel_copy, "2.0f")
    assert _run_constant(device) == 2.0


def test_same_text_is_built_once(device, kernel_copy):
    _write_constant(kernel_copy, "3.0f")
    first = program.build(device, "constant.cl", Features())
    assert program.build(device, "constant.cl", Features()) is first
    assert program.build(device, "constant.cl", Features(residual=True)) is not first


def test_includes_come_once_and_all():
    text = program.expand("tools/probe.cl", Features())
    assert text.count("typedef struct { float theta, sin_theta, cos_theta;") <= 1
    assert text.count("static inline Incidence incidence_at") == 1
    assert '#include "' not in text


def test_missing_include_names_file_and_line(kernel_copy):
    (kernel_copy / "lost.cl").write_text('\n#include "nowhere.clh"\n')
    with pytest.raises(KernelBuildError, match=r"lost\.cl:2: #include 'nowhere\.clh'"):
        program.expand("lost.cl", Features())


def test_missing_define_is_an_error(device):
    text = "#define FURCL_SAMPLING 2\n" + program.expand("stages/generate.cl", Features())
    with pytest.raises(cl.Error, match="a FURCL_\\* define is missing"):
        cl.Program(device.context, text).build(list(program.OPTIONS))


def test_build_error_shows_the_compilers_words(device, kernel_copy):
    (kernel_copy / "wrong.cl").write_text("__kernel void wrong() { undeclared_name = 1; }\n")
    with pytest.raises(KernelBuildError, match="undeclared_name"):
        program.build(device, "wrong.cl", Features())


@pytest.mark.parametrize("name", KERNELS)
def test_kernel_files_have_a_banner_and_no_globals(name):
    text = (program.kernel_folder() / name).read_text()
    for word in ("reads", "writes", "over"):
        assert word in text
    at_file_scope = [
        line for line in program.expand(name, Features()).splitlines()
        if line.startswith(("__constant ", "constant ", "__global ", "global "))
    ]  # fmt: skip
    assert at_file_scope == []


def test_debug_dump(device, kernel_copy, tmp_path, monkeypatch):
    monkeypatch.setenv("FURCL_DUMP", str(tmp_path / "dump"))
    _write_constant(kernel_copy, "4.0f")
    program.build(device, "constant.cl", Features())
    (dumped,) = (tmp_path / "dump").iterdir()
    assert "#define VALUE 4.0f" in dumped.read_text()


def test_features_are_the_only_defines():
    defines = Features().defines()
    assert all(
        name.startswith("FURCL_") and isinstance(value, int) for name, value in defines.items()
    )
    assert Features(residual=True).defines()["FURCL_LOBES"] == 6


@pytest.mark.parametrize("light_sampling", [False, True])
@pytest.mark.parametrize("channels", [1, 3])
def test_planes_follow_the_features(channels, light_sampling):
    features = Features(channels=channels, light_sampling=light_sampling)
    names = layout.planes(features)
    assert len(names) == len(set(names))
    assert ("SHADOW_DIR_X" in names) == light_sampling
    assert sum(name.startswith("THROUGHPUT") for name in names) == channels
    text = layout.device_text(features)
    assert all(f"PS_{name}" in text for name in names)


def test_struct_offsets_of_the_host_are_checked():
    words = layout.struct_words()
    layout.check_structs(words)
    wrong = words.copy()
    wrong[3] += 4
    with pytest.raises(LayoutError, match="allows no padding"):
        layout.check_structs(wrong)


@pytest.mark.parametrize("name", layout.STRUCTS)
def test_structs_need_no_padding(name):
    assert layout.struct_dtype(name).itemsize % 16 == 0


def test_too_large_a_buffer_is_refused_by_name(device):
    memory = Memory(device)
    with pytest.raises(ResourceError, match=r"'film' needs \d+ MiB"):
        memory.allocate("film", device.max_allocation_bytes + 1)


def test_memory_counts_bytes(device):
    memory = Memory(device)
    memory.upload("a", np.zeros(5, np.float32))
    memory.allocate("b", 100)
    assert memory.bytes == {"a": 20, "b": 100}
    assert memory.total_bytes == 120
