"""Files and lines that a path passes from camera to film: python bench/count_path.py [SCENE].

Of the kernels every file whose text is in the build of a stage, as `Wavefront` builds it; of Python
every file of furcl with a function that runs while waves are traced, seen by the interpreter in a
render of a few pixels under a sky that is sampled. Of the kernels the lines count that the scene's
builds leave in, of Python whole files, both with their comments. What
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
        for name in (
            "prelude",
            "math",
            "cdf",
            "spectrum",
            "lanes",
            "queue_lanes",
            "shares",
            "rng",
            "path_numbers",
            "sobol",
        )
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
    kernels: dict[str, set[int]] = {}
    for text in renderer.wavefront.texts():
        for label, numbers in _lines_left(text).items():
            kernels.setdefault(_place(label), set()).update(numbers)
    left = {file: len(numbers) for file, numbers in sorted(kernels.items())}
    return Count(left, _lines(_files_that_run(lambda: renderer.advance(1))))


def _place(label: str) -> str:
    """The file that a #line directive of an expanded kernel names, relative to the repository."""
    folder = kernel_folder()
    places = (folder / label, folder / "include" / label)
    return next(p for p in places if p.is_file()).relative_to(REPOSITORY).as_posix()


def _lines_left(text: str) -> dict[str, set[int]]:
    """The lines of each file of an expanded kernel that no condition of its build takes away."""
    # A word of its own in every branch shows which of them the preprocessor leaves.
    marked, place, branches = [], ("", 0), [0]
    lines: list[tuple[str, int, tuple[int, ...]]] = []
    n = 0
    for line in text.splitlines():
        marked.append(line)
        moved = re.match(r'#line (\d+) "(.+)"', line)
        directive = re.match(r"\s*#\s*(if|elif|else|endif)", line)
        if moved:
            place = moved[2], int(moved[1]) - 1
            continue
        place = place[0], place[1] + 1
        if directive and directive[1] != "if":
            branches.pop()
        lines.append((*place, tuple(branches)))
        if directive and directive[1] != "endif":
            n += 1
            branches.append(n)
            marked.append(f"BRANCH_{n}")
    left = {0, *map(int, re.findall(r"\bBRANCH_(\d+)\b", preprocessed("\n".join(marked))))}
    found: dict[str, set[int]] = {}
    for label, number, inside in lines:
        if label and left.issuperset(inside):
            found.setdefault(label, set()).add(number)
    return found


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
