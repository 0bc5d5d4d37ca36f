"""Building kernels: each text once a process, and from a cache between processes."""

from __future__ import annotations

import hashlib
import logging
import os
import re
import threading
import time
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path

import pyopencl as cl
from pyopencl import _cl

from furcl.device import kernel_cache, layout
from furcl.device.build_errors import DOES_NOT_COMPILE, names_a_place
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.device.pocl_library import for_compiler
from furcl.device.runtime_caches import cache_of
from furcl.device.source import kernel_text
from furcl.errors import KernelBuildError

log = logging.getLogger(__name__)

OPTIONS = ("-cl-std=CL1.2", "-Werror")

# Programs of this process, by context and text, the last ones used; and their locks.
KEPT_PROGRAMS = 64
_programs: OrderedDict[tuple[cl.Context, str], cl.Program] = OrderedDict()
_lock = threading.Lock()


def build(
    device: Device,
    names: str | Sequence[str],
    features: Features,
    extra: Mapping[str, int] | None = None,
) -> cl.Program:
    """Build one program of files in kernels/, for `features` on a device.

    The same text on the same device is built once while it is among the last KEPT_PROGRAMS that
    were used. Between processes a cache serves, keyed by the whole text: the runtime's own or
    furcl.device.kernel_cache. FURCL_DUMP=DIR writes each text there.

    Raises
    ------
    KernelBuildError    with the compiler's log, the features and where the text is
    """
    text = for_compiler(device, kernel_text(names, features, extra))
    key = (device.context, text)
    with _lock:
        if key in _programs:
            _programs.move_to_end(key)
            return _programs[key]
    label = names if isinstance(names, str) else ", ".join(names)
    program = _build(device, label, text, features)
    with _lock:
        _programs[key] = program
        while len(_programs) > KEPT_PROGRAMS:
            _programs.popitem(last=False)
    return program


def kernel_of(built: cl.Program, name: str) -> cl.Kernel:
    """A kernel of a program by its name.

    Raises
    ------
    KernelBuildError    the program has none: the runtime took another from its cache
    """
    try:
        return cl.Kernel(built, name)
    except cl.Error as error:
        runtime = built.devices[0].platform.name
        cache = cache_of(runtime)
        advice = f"; {cache.advice}" if cache else ""
        raise KernelBuildError(f"{runtime} has no kernel {name}: {error}{advice}") from error


def forget_programs() -> None:
    """Let go of the programs, and the contexts, that this process keeps."""
    with _lock:
        _programs.clear()


def _build(device: Device, name: str, text: str, features: Features) -> cl.Program:
    dump = os.environ.get("FURCL_DUMP")
    digest = hashlib.sha256(text.encode()).hexdigest()[:12]
    if dump:
        Path(dump).mkdir(parents=True, exist_ok=True)
        (Path(dump) / f"{re.sub(r'[/, ]+', '.', name)}.{digest}.cl").write_text(
            text, encoding="utf-8"
        )
    start = time.perf_counter()
    path = kernel_cache.binary_path(device, text, OPTIONS)
    try:
        program = kernel_cache.load(device, path, OPTIONS)
        if program is None:
            raw = _cl._Program(device.context, text)
            program = kernel_cache.built(raw, OPTIONS)
            kernel_cache.store(program, path)
    except (cl.Error, KernelBuildError) as error:
        said = with_places(str(error), text)
        cache = None if names_a_place(said) else cache_of(device.platform)
        advice = f"\n{cache.advice}" if cache else ""
        raise KernelBuildError(
            f"{name} {DOES_NOT_COMPILE} on {device.name} ({device.platform}) with "
            f"{features.describe()}; FURCL_DUMP=DIR writes the text. The compiler says:\n"
            f"{said}{advice}"
        ) from error
    log.debug("built %s in %.2f s", name, time.perf_counter() - start)
    return program


def with_places(said: str, text: str) -> str:
    """A compiler's message with the files and lines that its line numbers stand for.

    NVIDIA's compiler passes over #line: it numbers the lines of the whole text, "<kernel>:171:24".
    """
    return re.sub(r"<kernel>:(\d+)", lambda match: layout.place_in_file(text, int(match[1])), said)
