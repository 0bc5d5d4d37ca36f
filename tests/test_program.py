"""Building kernels: includes, declarations, and that no build is ever stale or made twice."""

import dataclasses
import os
import platform
import re
import shutil
import subprocess
import threading
import warnings

import numpy as np
import pyopencl as cl
import pytest
from kernel_harness import built

from furcl.device import kernel_cache, layout, program, source
from furcl.device.features import Features
from furcl.device.memory import Memory
from furcl.device.runtime_caches import POCL
from furcl.errors import KernelBuildError
from furcl.fibre import samplers
from furcl.fibre.double_cylinder.features import DoubleCylinderFeatures
from furcl.light import kinds as lights
from furcl.paths import python_command
from furcl.rendering.wavefront import stage_defines, stage_files
from furcl.surface.ellipsoid import PART as ELLIPSOID

VALUE = "__kernel void value(__global float* out) { out[0] = VALUE; }\n"


@pytest.fixture
def kernel_copy(tmp_path, monkeypatch):
    """A copy of the kernels that a test may edit."""
    folder = tmp_path / "kernels"
    shutil.copytree(source.kernel_folder(), folder)
    monkeypatch.setattr(source, "kernel_folder", lambda: folder)
    program.forget_programs()
    yield folder
    program.forget_programs()


@pytest.fixture
def compilations(monkeypatch):
    """Grows by one whenever a text is compiled."""
    calls, compile_text = [], kernel_cache.built

    def counted(raw, options):
        calls.append(raw)
        return compile_text(raw, options)

    monkeypatch.setattr(kernel_cache, "built", counted)
    return calls


def _write(folder, name, text):
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)


def _write_value(folder, value):
    _write(folder, "include/value.clh", f"#define VALUE {value}\n")
    _write(folder, "value.cl", '#include "core/prelude.clh"\n#include "value.clh"\n' + VALUE)


def _value(device, features=None):
    """What the kernel of value.cl computes."""
    kernel = cl.Kernel(program.build(device, "value.cl", features or Features()), "value")
    memory = Memory(device)
    out = memory.allocate("out", 16)
    kernel(device.queue, (1,), (1,), out)
    return float(memory.read(out, 1)[0])


# Includes ---------------------------------------------------------------------------------------


def test_edited_include_is_never_stale(device, kernel_copy):
    for value in (1.0, 2.0, 1.0):
        _write_value(kernel_copy, f"{value}f")
        assert _value(device) == value


@pytest.fixture
def expansions(monkeypatch):
    """Grows by one whenever files are read for a text."""
    calls, expand = [], source.expand

    def counted(*arguments):
        calls.append(arguments)
        return expand(*arguments)

    monkeypatch.setattr(source, "expand", counted)
    return calls


def _aged(folder):
    """Files as they would be had nobody written them for a minute."""
    for path in folder.rglob("*.cl*"):
        os.utime(path, (path.stat().st_atime - 60.0, path.stat().st_mtime - 60.0))


def _another_value(folder):
    _write_value(folder, "2.0f")


def _another_value_beside(folder):
    _write(folder, "value.clh", "#define VALUE 2.0f\n")


def test_a_text_is_made_once(device, kernel_copy, expansions):
    _write_value(kernel_copy, "1.0f")
    _aged(kernel_copy)
    assert [_value(device) for _ in range(3)] == [1.0] * 3
    assert len(expansions) == 1


@pytest.mark.parametrize("edit", [_another_value, _another_value_beside])
def test_a_text_that_is_kept_is_never_stale(device, kernel_copy, expansions, edit):
    """An include that was edited, and one that comes before it now."""
    _write_value(kernel_copy, "1.0f")
    _aged(kernel_copy)
    assert _value(device) == 1.0
    edit(kernel_copy)
    assert _value(device) == 2.0
    assert len(expansions) == 2


def test_an_include_that_two_files_ask_for_comes_once(device, kernel_copy):
    """Twice, it would not compile."""
    _write(kernel_copy, "include/base.clh", "static inline float base(void) { return 3.0f; }\n")
    for name in ("left", "right"):
        text = f'#include "base.clh"\nstatic inline float {name}(void) {{ return base(); }}\n'
        _write(kernel_copy, f"include/{name}.clh", text)
    text = '#include "left.clh"\n#include "right.clh"\n#define VALUE left() + right()\n'
    _write(kernel_copy, "value.cl", text + VALUE)
    assert _value(device) == 6.0


@pytest.mark.parametrize("condition", ["#if 0", "#if 1", "#ifdef NONE\n#else"])
def test_an_include_under_a_condition_hides_no_other(device, kernel_copy, condition):
    """Whether the condition holds or not, who asks for the file later has it, once."""
    base = "static inline float base(void) { return 3.0f; }\n"
    _write(kernel_copy, "include/base.clh", f"#ifndef BASE\n#define BASE\n{base}#endif\n")
    left = f'#ifndef LEFT\n#define LEFT\n{condition}\n#include "base.clh"\n#endif\n#endif\n'
    _write(kernel_copy, "include/left.clh", left)
    text = '#include "left.clh"\n#include "base.clh"\n#define VALUE base()\n'
    _write(kernel_copy, "value.cl", text + VALUE)
    assert _value(device) == 3.0


def test_a_file_beside_the_one_that_asks_comes_before_others_of_its_name(device, kernel_copy):
    _write(kernel_copy, "include/part.clh", "#define FAR 1.0f\n")
    _write(kernel_copy, "include/own/part.clh", "#define NEAR 2.0f\n")
    _write(kernel_copy, "include/own/whole.clh", '#include "part.clh"\n')
    text = '#include "own/whole.clh"\n#include "part.clh"\n#define VALUE NEAR + FAR\n'
    _write(kernel_copy, "value.cl", text + VALUE)
    assert _value(device) == 3.0


def test_a_part_is_the_header_that_the_features_name(device, kernel_copy):
    """Of two lights the one of the build is compiled; without a light that is an error."""
    _write(kernel_copy, "value.cl", "\n#include <light>\n" + VALUE)
    for number, kind in ((1.0, "constant"), (2.0, "sky")):
        part = lights.find(kind).part()
        _write(kernel_copy, f"include/{part.header}", f"#define VALUE {number}f\n")
        assert _value(device, Features(light=part)) == number
    with pytest.raises(KernelBuildError, match="this build has no <light>"):
        program.build(device, "value.cl", Features())
    _write(kernel_copy, "value.cl", "#if 0\n#include <light>\n#endif\n#define VALUE 3\n" + VALUE)
    assert _value(device) == 3.0


@pytest.mark.parametrize("asked_by", ["lost.cl", "include/lost.clh"])
def test_missing_include_names_file_and_line(device, kernel_copy, asked_by):
    _write(kernel_copy, "lost.cl", '#include "lost.clh"\n')
    _write(kernel_copy, asked_by, '\n#include "nowhere.clh"\n')
    label = asked_by.removeprefix("include/")
    with pytest.raises(KernelBuildError, match=rf"^{label}:2: #include 'nowhere\.clh'"):
        program.build(device, "lost.cl", Features())


# Declarations -----------------------------------------------------------------------------------


@pytest.mark.parametrize("value", ["FURCL_NO_SUCH_NAME", "0\n#if FURCL_LENZ\n#endif"])
def test_a_name_that_nobody_declares_is_an_error(device, kernel_copy, value):
    """In an #if a misspelt name would be 0 without a word."""
    line = 1 + value.count("\n") - (value.count("\n") > 0)
    _write_value(kernel_copy, value)
    with pytest.raises(KernelBuildError, match=rf"^value\.clh:{line}: FURCL_\w+ is declared nei"):
        program.build(device, "value.cl", Features())


def test_names_in_comments_and_of_the_text_itself_are_no_error(device, kernel_copy):
    _write_value(
        kernel_copy, "FURCL_HERE /* FURCL_THERE */ // FURCL_ELSEWHERE\n#define FURCL_HERE 4"
    )
    assert _value(device) == 4.0


FULL = Features(
    fibre=DoubleCylinderFeatures(),
    sampler=samplers.find("full-cdf"),
    light=lights.find("constant").part(),
    surface=ELLIPSOID,
    light_sampling=True,
)


TRACING = "intersect_closest intersect_shadow"
SCATTERING = "sample_lobe_h shade"


@pytest.mark.parametrize(
    ("change", "recompiled", "kept"),
    [
        ({"filter": "box"}, "generate", f"{TRACING} sample_lobe_h shade add_to_film"),
        ({"lens": True}, "generate", TRACING),
        ({"variance": False}, "add_to_film", f"generate {TRACING} {SCATTERING} shade_surface"),
        ({"statistics": False}, "sample_lobe_h", f"generate {TRACING} shade add_to_film"),
        ({"point_radii": False}, f"{TRACING} {SCATTERING}", "generate shade_escaped add_to_film"),
        (
            {"light": lights.find("sky").part()},
            "shade shade_escaped shade_surface",
            f"generate {TRACING} sample_lobe_h add_to_film",
        ),
        (
            {"sampler": samplers.find("uniform-h")},
            SCATTERING,
            f"generate {TRACING} shade_escaped shade_surface add_to_film",
        ),
        (
            {"fibre": DoubleCylinderFeatures(tilt=False)},
            SCATTERING,
            f"generate {TRACING} shade_escaped shade_surface add_to_film",
        ),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_a_change_recompiles_the_stages_that_name_it(device, change, recompiled, kept):
    """A build's text holds the declarations that it names, and no others."""
    changed = {
        stage
        for stage, file in stage_files(FULL).items()
        if source.kernel_text(file, FULL, stage_defines(stage, device))
        != source.kernel_text(file, FULL.with_(**change), stage_defines(stage, device))
    }
    assert changed >= set(recompiled.split())
    assert changed.isdisjoint(kept.split())


# Builds -----------------------------------------------------------------------------------------


def test_a_text_is_compiled_once_a_process(device, kernel_copy, compilations):
    """Whatever the features are that it does not name; until another text stands in the files."""
    _write_value(kernel_copy, "5.0f")
    first = program.build(device, "value.cl", Features())
    assert program.build(device, "value.cl", Features()) is first
    assert program.build(device, "value.cl", Features(lens=True)) is first
    assert len(compilations) == 1
    _write_value(kernel_copy, "FURCL_LENS")
    assert [_value(device, Features(lens=lens)) for lens in (False, True)] == [0.0, 1.0]
    assert len(compilations) == 3


def test_programs_used_longest_ago_are_let_go(device, kernel_copy, compilations, monkeypatch):
    monkeypatch.setattr(program, "KEPT_PROGRAMS", 2)

    def use(value):
        _write_value(kernel_copy, f"{value}.0f")
        assert _value(device) == value

    for value in (1, 2, 1, 3, 1):
        use(value)
    assert len(compilations) == 3
    use(2)
    assert len(compilations) == 4


def test_threads_that_build_bring_no_warnings(device, kernel_copy):
    """What a compiler says of a good text stays between it and furcl: not a Python warning in any
    thread, and the caller's filters are as they were. pyopencl alone would warn."""
    chatty = '#pragma message("done")\n' + VALUE
    names = [f"chatty{i}.cl" for i in range(8)]
    for i, name in enumerate(names):
        _write(kernel_copy, name, f"#define VALUE {i}\n{chatty}")

    def build(mine):
        for name in mine:
            program.build(device, name, Features())

    threads = [threading.Thread(target=build, args=(names[i::2],)) for i in range(2)]
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        filters = list(warnings.filters)
        for thread in threads:
            thread.start()
        warnings.warn("the caller's own", cl.CompilerWarning, stacklevel=1)
        for thread in threads:
            thread.join()
        assert warnings.filters == filters
    assert [str(warning.message) for warning in seen] == ["the caller's own"]
    with pytest.warns(cl.CompilerWarning):
        cl.Program(device.context, "#define VALUE 9\n" + chatty).build(list(program.OPTIONS))


@pytest.mark.parametrize(
    ("said", "cache_may_be_the_cause"),
    [
        ("clBuildProgram failed: BUILD_PROGRAM_FAILURE", True),
        ("error: <invalid loc>: unable to open output file '/x.cl': 'No such file'", True),
        ("error: value.cl:1:30: use of undeclared identifier", False),
        ("<kernel>:1:30: error: use of undeclared identifier", False),
    ],
)
def test_build_error_without_a_place_names_the_runtimes_cache(
    device, kernel_copy, monkeypatch, said, cache_may_be_the_cause
):
    def fails(*arguments):
        raise KernelBuildError(said)

    monkeypatch.setattr(kernel_cache, "built", fails)
    monkeypatch.setenv("POCL_CACHE_DIR", "/built")
    pocl = dataclasses.replace(device, platform="Portable Computing Language 3.1")
    _write_value(kernel_copy, "7")
    with pytest.raises(KernelBuildError, match="does not compile") as raised:
        program.build(pocl, "value.cl", Features())
    advice = "remove /built, or let POCL_CACHE_DIR name another folder"
    assert (advice in str(raised.value)) == cache_may_be_the_cause


def test_build_error_shows_the_compilers_words(device, kernel_copy):
    _write(kernel_copy, "wrong.cl", "__kernel void wrong() { undeclared_name = 1; }\n")
    with pytest.raises(KernelBuildError, match="undeclared_name"):
        program.build(device, "wrong.cl", Features())


def test_a_dumped_text_is_what_is_compiled(device, kernel_copy, tmp_path, monkeypatch):
    monkeypatch.setenv("FURCL_DUMP", str(tmp_path / "dump"))
    _write_value(kernel_copy, "FURCL_CHANNELS + 4.0f")
    assert _value(device) == 7.0
    (dumped,) = (tmp_path / "dump").iterdir()
    monkeypatch.delenv("FURCL_DUMP")
    _write(kernel_copy, "value.cl", dumped.read_text())
    assert _value(device) == 7.0


@pytest.mark.parametrize("wanted", ["core/prelude.clh", "core/rng.clh", "stages/generate.cl"])
def test_lines_of_a_text_are_lines_of_files(wanted):
    """Compilers that pass over #line number the whole text."""
    text = source.expand("stages/generate.cl", Features())
    folder = source.kernel_folder()
    path = next(p for p in (folder / wanted, folder / "include" / wanted) if p.is_file())
    numbered = dict(enumerate(path.read_text().splitlines(), 1))
    found = 0
    for n, line in enumerate(text.splitlines(), 1):
        file, _, number = layout.place_in_file(text, n).rpartition(":")
        if file == wanted and not line.startswith("#line"):
            assert line == numbered[int(number)]
            message = program.with_places(f"<kernel>:{n}:7: error", text)
            assert message == f"{wanted}:{number}:7: error"
            found += 1
    assert found == sum(not line.startswith("#include") for line in numbered.values())


RENDER = """
import sys
from furcl.cli import main
main(["-q", "render", "single_fibre", "--size", "8x8", "--spp", "1", *sys.argv[1:]])
"""


def test_the_library_of_pocl_is_inlined(device, tmp_path):
    """No built kernel calls a function of PoCL's library: with AVX-512 that is 2 to 3 times as fast
    (docs/notebook.md)."""
    if not device.platform.startswith(POCL):
        pytest.skip(f"{device.platform} is not PoCL")
    options = ["-o", str(tmp_path / "a.exr"), "--device", device.name]
    environment = {**os.environ, "POCL_CACHE_DIR": str(tmp_path / "pocl")}
    subprocess.run(python_command("-c", RENDER, *options), env=environment, check=True)
    built = {file.name: file.read_bytes() for file in (tmp_path / "pocl").rglob("*.so")}
    assert built.keys() >= {"intersect_closest.so", "shade.so"}
    # Functions of PoCL's own begin so, mangled; of those that are inlined nothing is left.
    calling = [name for name, content in built.items() if re.search(rb"_Z\d+_cl_fma", content)]
    assert not calling


WIDE = """
#pragma clang attribute push(__attribute__((target("no-avx512f"))), apply_to=function)
__attribute__((noinline)) float16 twice(float16 x) { return x + x; }
__kernel void wide(__global float16* y) { y[get_global_id(0)] = twice(y[get_global_id(0)]); }
#pragma clang attribute pop
"""


def test_wide_vectors_go_into_functions_without_avx512(device):
    """PoCL's compiler warns of them, which `-Werror` makes an error, unless it is told not to."""
    if not device.platform.startswith(POCL) or platform.machine() != "x86_64":
        pytest.skip(f"{device.platform} on {platform.machine()} is not PoCL on x86-64")
    values = np.arange(64, dtype=np.float32)
    memory = Memory(device)
    buffer = memory.upload("wide", values)
    cl.Kernel(built(device, WIDE), "wide")(device.queue, (4,), None, buffer)
    assert np.array_equal(memory.read(buffer, values.size), 2.0 * values)
    # As it is without: the same text fails.
    with pytest.raises(cl.RuntimeError, match="changes the ABI"):
        cl.Program(device.context, WIDE).build(list(program.OPTIONS))


def test_a_kernel_that_the_runtime_lost_is_told(device):
    """As where PoCL takes a damaged program from its cache."""
    built = program.build(device, "stages/film.cl", Features(), {"FURCL_PATHS_PER_ITEM": 1})
    advice = ".*remove " if device.platform.startswith(POCL) else ""
    with pytest.raises(KernelBuildError, match=f"has no kernel nothing: {advice}"):
        program.kernel_of(built, "nothing")
