"""Command lines of furcl, run in this process."""

import pytest

from furcl.cli import main


def run(*arguments: object) -> int:
    """Run a command line; its exit code."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    code = ended.value.code
    return code if isinstance(code, int) else int(code is not None)
