"""Files and lines that a path passes from camera to film: python bench/count_path.py [SCENE].

Of the kernels every file whose text is in the build of a stage, as `Wavefront` builds it; of Python
every file of furcl with a function that runs while waves are traced, seen by the interpreter in a
render of a few pixels under a sky that is sampled. Whole files count, with their comments. What
any program needs and a reader knows, functions of mathematics, vectors, random numbers, launches
and memory, counts apart (UTILITIES): so it is in the figures of other renderers.
`--page docs/architecture.md` writes the table into that page.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tables import filled

import furcl
from furcl.bench.features import preprocessed
from furcl.device.choice import Device
from furcl.paths import kernel_folder
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene

REPOSITORY = Path(__file__).parents[1]
SCENE = "single_fibre"  # fibres of one material and no surface
# The light sampled, and nothing that learns or plans.
SETTINGS = ('environment={kind="sky"}', "render.light_sampling=mis", "render.roulette=depth")
PIXELS = "8x8"
UTILITIES = (
    *(
        f"kernels/include/core/{name}.clh"
        for name in ("prelude", "math", "cdf", "spectrum", "lanes", "rng", "sobol")
    ),
    "furcl/device/",
)
MARK = "files of a path"


@dataclass(frozen=True)
class Count:
    """Files, relative to the repository, and the lines of each."""

    kernels: dict[str, int]
    python: dict[str, int]

    @property
    def path(self) -> dict[str, int]:
        """The files that are no utilities."""
        every = {**self.kernels, **self.python}
        return {file: lines for file, lines in every.items() if not file.startswith(UTILITIES)}

    @property
    def utilities(self) -> dict[str, int]:
        """The others."""
        every = {**self.kernels, **self.python}
        return {file: lines for file, lines in every.items() if file.startswith(UTILITIES)}

    def table(self) -> str:
        """What the page shows: sums, and the files by folder."""
        rows = []
        for title, files in (("path", self.path), ("utilities", self.utilities)):
            folders: dict[str, list[str]] = {}
            for file, lines in files.items():
                folder, _, name = file.rpartition("/")
                folders.setdefault(folder, []).append(f"{name} {lines}")
            rows += [f"| {title} | `{folder}/` | {', '.join(n)} |" for folder, n in folders.items()]
        sums = (
            f"{len(self.path)} files of {sum(self.path.values())} lines; and "
            f"{len(self.utilities)} of {sum(self.utilities.values())} lines with utilities."
        )
        head = ["| | folder | files and their lines |", "|---|---|---|"]
        return "\n".join([sums, "", *head, *rows])


def count(scene: str = SCENE, device: str | Device | None = None) -> Count:
    """What the paths of a scene pass."""
    renderer = Renderer(load_scene(scene, size=PIXELS, overrides=SETTINGS), device)
    kernels = {f for text in renderer.wavefront.texts() for f in _files_of(text)}
    return Count(_lines(kernels), _lines(_files_that_run(lambda: renderer.advance(1))))


def _files_of(text: str) -> set[Path]:
    """The files of which the compiler sees something in an expanded kernel."""
    folder = kernel_folder()
    # In front of the first line of a file, which only the text of that file has.
    marked = re.sub(r'^#line 1 "(.+)"$', r'#line 1 "\1"\nfurcl_file("\1")', text, flags=re.M)
    labels = set(re.findall(r'furcl_file\("(.+)"\)', preprocessed(marked)))
    places = [(folder / label, folder / "include" / label) for label in labels]
    return {next(place for place in both if place.is_file()) for both in places}


def _files_that_run(call: Callable[[], object]) -> set[Path]:
    """The files of furcl with a function that runs in a call."""
    seen: set[str] = set()

    def look(frame, event, argument) -> None:
        if event == "call":
            seen.add(frame.f_code.co_filename)

    sys.setprofile(look)
    try:
        call()
    finally:
        sys.setprofile(None)
    package = Path(furcl.__file__).parent
    return {Path(name) for name in seen if Path(name).is_relative_to(package)}


def _lines(files: set[Path]) -> dict[str, int]:
    return {
        file.relative_to(REPOSITORY).as_posix(): len(file.read_text().splitlines())
        for file in sorted(files)
    }


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default=SCENE)
    parser.add_argument("--device")
    parser.add_argument("--page", type=Path)
    arguments = parser.parse_args()
    found = count(arguments.scene, arguments.device)
    if arguments.page:
        page = filled(arguments.page.read_text(), {MARK: found.table})
        arguments.page.write_text(page)
    else:
        print(found.table())


if __name__ == "__main__":
    main()
