"""`pytest --time-limit S` skips what has not begun by then, and says so."""

import subprocess
from pathlib import Path

import pytest

from furcl.paths import python_command


@pytest.mark.parametrize(("seconds", "outcome"), [("0", "3 skipped"), ("600", "3 passed")])
def test_what_has_not_begun_is_skipped(seconds, outcome):
    tests = f"{Path(__file__).parent / 'test_device.py'}::test_philox_known_answers"
    options = ("-n", "0", "-r", "s", "-p", "no:cacheprovider", "--time-limit", seconds)
    done = subprocess.run(
        python_command("-m", "pytest", *options, tests),
        capture_output=True,
        text=True,
    )
    assert outcome in done.stdout
    assert (f"the time limit of {seconds} s is over" in done.stdout) == ("skipped" in outcome)
