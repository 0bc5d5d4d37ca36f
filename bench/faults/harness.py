"""What cases share: commands in processes of their own, their peak memory, and refusals."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from furcl.errors import FurclError

REPOSITORY = Path(__file__).parents[2]
FURCL = (sys.executable, "-P", "-c", "from furcl.cli import main; main()")
TIMEOUT_S = 1800.0

#: A render of a second, and the arguments that make it small.
SMALL = ("render", "single_fibre", "--size", "16x16", "--spp", "2")


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes
    ----------
    code : int          exit code, negative for a signal
    out, err : str      what it wrote
    peak_bytes : int    the most memory that it held
    """

    code: int
    out: str
    err: str
    peak_bytes: int


def environment(**changes: str | None) -> dict[str, str]:
    """This process's environment with names replaced, or taken out by None."""
    path = os.pathsep.join([str(REPOSITORY), str(REPOSITORY / "bench")])
    new = {**os.environ, "PYTHONPATH": path, **changes}
    return {name: value for name, value in new.items() if value is not None}


def in_fork(work: Callable[[], object]) -> int:
    """Run work in a fork of this process, which says nothing; how that ended, as `os.waitpid` has
    it, 0 being well."""
    child = os.fork()
    if not child:
        code = 1
        try:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
            work()
            code = 0
        finally:
            os._exit(code)
    return os.waitpid(child, 0)[1]


def start(
    command: Sequence[str], env: Mapping[str, str] | None = None, **options
) -> subprocess.Popen[str]:
    """Start a command whose output is caught, as text."""
    return subprocess.Popen(
        command,
        env=dict(environment() if env is None else env),
        text=True,
        errors="backslashreplace",
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options},
    )


def run(
    command: Sequence[str],
    env: Mapping[str, str] | None = None,
    *,
    timeout_s: float = TIMEOUT_S,
    **options,
) -> Ended:
    """Run a command to its end."""
    # A process between asks for the peak of its one child; ours has had others.
    measure = (
        "import json, os, resource, subprocess, sys\n"
        "code = subprocess.call(sys.argv[2:])\n"
        "peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024\n"
        "open(sys.argv[1], 'w').write(json.dumps([code, peak]))\n"
    )
    import json
    import tempfile

    with tempfile.NamedTemporaryFile("r", suffix=".json") as told:
        wrapped = [sys.executable, "-I", "-c", measure, told.name, *command]
        with start(wrapped, env, **options) as child:
            try:
                out, err = child.communicate(timeout=timeout_s)
            except subprocess.TimeoutExpired:
                child.kill()
                raise AssertionError(f"no end after {timeout_s:.0f} s: {command}") from None
        text = told.read()
    code, peak = json.loads(text) if text else (child.returncode, 0)
    return Ended(code, out or "", err or "", peak)


def furcl(*arguments: object, env: Mapping[str, str] | None = None, **options) -> Ended:
    """Run the command furcl."""
    return run([*FURCL, *(str(argument) for argument in arguments)], env, **options)


def told(ended: Ended, code: int, *words: str) -> str:
    """The last line of what a command said, after a check of code, words, and no traceback."""
    said = ended.out + ended.err
    assert "Traceback" not in said, f"a traceback: {said.strip().splitlines()[-1]}"
    assert ended.code == code, f"ended with {ended.code}, not {code}: {said.strip()[-300:]}"
    for word in words:
        assert word in said, f"does not say {word!r}: {said.strip()[-300:]}"
    lines = said.strip().splitlines()
    return f"code {code}: {lines[-1][:160]}" if lines else f"code {code}"


def refused(
    call: Callable[[], object], error: type[FurclError] | tuple[type[FurclError], ...], *words: str
) -> str:
    """The message of an error that a call must raise, with words that it must have."""
    try:
        call()
    except error as caught:
        message = str(caught)
    except Exception as caught:
        raise AssertionError(f"{type(caught).__name__}: {str(caught)[:200]}") from caught
    else:
        raise AssertionError("accepted")
    for word in words:
        assert word in message, f"does not say {word!r}: {message}"
    return message
