"""A sampler of one's own that is wrong: what tests of bias must see."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from furcl.fibre import samplers


@contextmanager
def biased_sampler(folder: Path, factor: float) -> Iterator[str]:
    """The name of `uniform-h` with a density that is reported `factor` times as large as it is."""
    text = samplers.find("uniform-h").text()
    assert text.count("r.joint = joint[p];") == 1
    header = folder / "wrong.clh"
    header.write_text(text.replace("r.joint = joint[p];", f"r.joint = {factor}f * joint[p];"))
    samplers.register("wrong", header, needs_tables=False)
    try:
        yield "wrong"
    finally:
        samplers.unregister("wrong")
