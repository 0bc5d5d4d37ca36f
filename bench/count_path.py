"""Files and lines that a path passes from camera to film: python bench/count_path.py [SCENE].

Of the kernels every file whose text is in a build of a render stage, includes expanded by the code
that builds; of Python every file of furcl that runs while waves are traced, seen by the interpreter
in a render of a few pixels. Whole files count, with their comments.
"""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from furcl.device import program
from furcl.paths import kernel_folder
from furcl.render.renderer import Renderer
from furcl.render.wavefront import STAGES
from furcl.scene.read import load_scene

REPOSITORY = Path(__file__).parents[1]
PIXELS = "8x8"


@dataclass(frozen=True)
class Count:
    """Files, relative to the repository, and the lines of each."""

    kernels: dict[str, int]
    python: dict[str, int]

    @property
    def files(self) -> int:
        """Number of files."""
        return len(self.kernels) + len(self.python)

    @property
    def lines(self) -> int:
        """Lines of all files."""
        return sum(self.kernels.values()) + sum(self.python.values())


def count(scene: str, device: str | None = None) -> Count:
    """What one material's paths pass in a scene."""
    renderer = Renderer(load_scene(scene, size=PIXELS), device)
    texts = [program.source(stage, renderer.features) for stage in sorted(set(STAGES.values()))]
    kernels = {file for text in texts for file in _files_of(text)}
    python = _files_that_run(lambda: renderer.advance(1))
    return Count(_lines(kernels), _lines(python))


def _files_of(text: str) -> set[Path]:
    """The files that an expanded kernel names; what is generated is in none."""
    names = set(re.findall(r'^#line 1 "(.+)"$', text, re.M))
    folder = kernel_folder()
    return {path for path in folder.rglob("*.cl*") for name in names if _is_at(path, name)}


def _is_at(path: Path, name: str) -> bool:
    return path.as_posix().endswith(f"/{name}")


def _files_that_run(call) -> set[Path]:
    """The files of furcl with a function that runs in a call."""
    package = Path(program.__file__).parents[1]
    seen: set[str] = set()

    def look(frame, event, argument) -> None:
        if event == "call":
            seen.add(frame.f_code.co_filename)

    sys.setprofile(look)
    try:
        call()
    finally:
        sys.setprofile(None)
    return {Path(name) for name in seen if Path(name).is_relative_to(package)}


def _lines(files: set[Path]) -> dict[str, int]:
    return {
        file.relative_to(REPOSITORY).as_posix(): len(file.read_text().splitlines())
        for file in sorted(files)
    }


def main() -> None:
    """Print the files with their lines, then the sums."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="black_hair")
    parser.add_argument("--device")
    arguments = parser.parse_args()
    found = count(arguments.scene, arguments.device)
    for file, lines in {**found.kernels, **found.python}.items():
        print(f"{lines:6d}  {file}")
    print(f"{found.lines:6d}  lines in {found.files} files")


if __name__ == "__main__":
    main()
