"""Kernel sources: include expansion, defines, build and cache."""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import re
import time
import warnings
from pathlib import Path

import pyopencl as cl

from furcl.device import kernel_cache, layout
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.errors import KernelBuildError
from furcl.paths import kernel_folder

log = logging.getLogger(__name__)

_INCLUDE = re.compile(r'^\s*#\s*include\s+["<]([^">]+)[">]\s*$')


def expand(name: str, features: Features, folder: Path | None = None) -> str:
    """The text of a kernel file with every #include replaced by what it names.

    Caches of OpenCL runtimes hash the text that they are given, not the files that it includes;
    given the whole text they cannot return a stale kernel. Each file is included once.

    Raises
    ------
    KernelBuildError    if an include is not found, naming the file and line that asks for it
    """
    folder = folder or kernel_folder()
    bases = (folder, folder / "include", features.sampler.clh.parent)
    seen: set[str] = set()

    def find(include: str) -> str | None:
        if include == "layout.clh":
            return layout.device_text(features)
        if include == "sampler.clh":
            return features.sampler.source()
        for base in bases:
            if (base / include).is_file():
                return (base / include).read_text()
        return None

    def walk(include: str, asked_by: str) -> list[str]:
        if include in seen:
            return []
        text = find(include)
        if text is None:
            raise KernelBuildError(
                f"{asked_by}: #include {include!r} is not found in {folder} or its include "
                f"folder; check the spelling"
            )
        seen.add(include)
        label = features.sampler.clh.name if include == "sampler.clh" else include
        lines = [f'#line 1 "{label}"']
        for number, line in enumerate(text.splitlines(), 1):
            match = _INCLUDE.match(line)
            if not match:
                lines.append(line)
                continue
            beside = str(Path(include).parent / match[1])
            target = beside if find(beside) is not None else match[1]
            lines += walk(target, f"{include}:{number}")
            lines.append(f'#line {number + 1} "{label}"')
        return lines

    return "\n".join(walk(name, name)) + "\n"


def source(name: str, features: Features, extra_defines: dict[str, int] | None = None) -> str:
    """Defines followed by the expanded text: all that decides what a kernel does."""
    defines = {**features.defines(), **(extra_defines or {})}
    head = "".join(f"#define {key} {value}\n" for key, value in sorted(defines.items()))
    return head + expand(name, features)


OPTIONS = ("-cl-std=CL1.2", "-Werror")


def build(
    device: Device,
    name: str,
    features: Features,
    extra_defines: dict[str, int] | None = None,
) -> cl.Program:
    """Build kernels/`name` for `features` on a device.

    The same text on the same device is built once a process. Between processes a cache serves,
    keyed by the whole text: the runtime's own or furcl.device.kernel_cache. FURCL_DUMP=DIR writes
    each text there.

    Raises
    ------
    KernelBuildError    with the compiler's log, the features and where the text is
    """
    return _build(device, name, source(name, features, extra_defines), features)


@functools.lru_cache(maxsize=256)
def _build(device: Device, name: str, text: str, features: Features) -> cl.Program:
    dump = os.environ.get("FURCL_DUMP")
    key = hashlib.sha256(text.encode()).hexdigest()[:12]
    if dump:
        Path(dump).mkdir(parents=True, exist_ok=True)
        (Path(dump) / f"{name}.{key}.cl").write_text(text)
    start = time.perf_counter()
    path = kernel_cache.binary_path(device, text, OPTIONS)
    # Intel's compiler says "done" and pyopencl warns of it. Not for these lines alone: another
    # thread that builds at the same time would bring the warning back.
    warnings.filterwarnings("ignore", category=cl.CompilerWarning)
    try:
        program = kernel_cache.load(device, path, OPTIONS)
        if program is None:
            unbuilt = cl.Program(device.context, text)
            # False: pyopencl's own cache on disk would be a second one.
            program = unbuilt.build(list(OPTIONS), cache_dir=False)  # pyright: ignore[reportArgumentType]
            kernel_cache.store(program, path)
    except cl.Error as error:
        raise KernelBuildError(
            f"{name} does not compile on {device.name} ({device.platform}) with {features}; "
            f"FURCL_DUMP=DIR writes the text. The compiler says:\n{error}"
        ) from error
    log.debug("built %s in %.2f s", name, time.perf_counter() - start)
    return program
