"""What losing standard error loses: nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from furcl.paths import python_command

FURCL = python_command("-c", "from furcl.cli import main; main()")
RENDER = ["-v", "render", "single_fibre", "--size", "8x8", "--spp", "1", "-o"]


def _closed_pipe() -> int:
    reader, writer = os.pipe()
    os.close(reader)
    return writer


@pytest.mark.parametrize("lost", ["closed", "full", "a pipe without a reader", "all three"])
def test_the_picture_is_there(lost, tmp_path):
    streams = {"closed": "2>&-", "full": "2>/dev/full", "all three": "0<&- 1>&- 2>&-"}
    command = ["sh", "-c", f'exec "$@" {streams.get(lost, "")}', "sh", *FURCL, *RENDER]
    out = tmp_path / "a.exr"
    error = _closed_pipe() if lost == "a pipe without a reader" else None
    done = subprocess.run([*command, str(out)], stderr=error, stdout=subprocess.PIPE)
    assert done.returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "a.png"]
    assert done.stdout == b""


@pytest.mark.parametrize("stream", ["2>&-", "2>/dev/full"])
def test_errors_keep_their_code(stream):
    command = ["sh", "-c", f'exec "$@" {stream}', "sh", *FURCL, "info", "nothing.toml"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")


def test_the_head_of_the_log_is_enough(tmp_path):
    """furcl render ... 2>&1 | head -1"""
    out = tmp_path / "a.exr"
    with subprocess.Popen(
        [*FURCL, *RENDER, str(out)], stderr=subprocess.STDOUT, stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout
        assert child.stdout.readline().startswith("furcl: ")
        child.stdout.close()
    assert child.returncode == 0
    assert out.exists()


def test_a_full_standard_output_is_still_said():
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*FURCL, "info", "single_fibre"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 2
    assert "No space left" in done.stderr


def test_the_stream_is_given_back(capsys):
    from furcl.cli import main

    before = sys.stderr
    with pytest.raises(SystemExit):
        main(["info", "nothing.toml"])
    assert sys.stderr is before
    assert "nothing.toml" in capsys.readouterr().err
