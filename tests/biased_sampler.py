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
    right = "return sample_lobe_at(fibre, in, 2.0f * xi.z - 1.0f, xi.y);"
    assert text.count(right) == 1
    wrong = f"LobeAndOffset r = {right.removeprefix('return ')} r.joint *= {factor}f; return r;"
    header = folder / "wrong.clh"
    header.write_text(text.replace(right, wrong))
    samplers.register("wrong", header, needs_tables=False)
    try:
        yield "wrong"
    finally:
        samplers.unregister("wrong")
