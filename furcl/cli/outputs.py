"""The files that `furcl render` writes: checked before the render, written after it."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from furcl.errors import ImageError
from furcl.files import atomic_path, check_writable

if TYPE_CHECKING:
    from furcl.image.image import Image

log = logging.getLogger(__name__)

SUFFIXES = (".exr", ".png")


@dataclass(frozen=True)
class Outputs:
    """Where the results of a render go.

    Attributes
    ----------
    pictures : tuple of Path        the picture and its preview
    partial : tuple of Path         the same, of a render that stopped before all pixels had samples
    checkpoint : Path               what the render goes on from, where it is stopped
    stats : Path or None
    denoised : tuple of Path        a denoised picture and its preview, where one is asked for
    """

    pictures: tuple[Path, ...]
    partial: tuple[Path, ...]
    checkpoint: Path
    stats: Path | None
    denoised: tuple[Path, ...] = ()

    @staticmethod
    def of(output: Path, stats: Path | None, *, denoise: bool = False) -> Outputs:
        """The files of `--output`, `--stats` and `--denoise`."""
        if output.suffix.lower() not in SUFFIXES:
            raise typer.BadParameter(f"{output}: the name must end with .exr or .png")
        pictures = tuple(dict.fromkeys((output, output.with_suffix(".png"))))
        return Outputs(
            pictures,
            tuple(path.with_suffix(f".partial{path.suffix}") for path in pictures),
            output.with_suffix(".checkpoint"),
            stats,
            tuple(path.with_suffix(f".denoised{path.suffix}") for path in pictures if denoise),
        )

    def check(self, inputs: Iterable[Path]) -> None:
        """Refuse what could not be written after the render, or would overwrite another file of
        the command; makes missing folders.

        Raises
        ------
        ImageError
        """
        for path in self._all():
            if path:
                check_writable(path, ImageError)
        if self.stats and _real(self.stats) in map(_real, (*self.pictures, self.checkpoint)):
            raise ImageError(
                f"--stats {self.stats}: is also the name of the picture, its preview or its "
                f"checkpoint; give another name"
            )
        self.check_apart(inputs)

    def check_apart(self, inputs: Iterable[Path]) -> None:
        """Refuse results in place of files that the render reads; ImageError."""
        read = {_real(path) for path in inputs}
        for path in self._all():
            if path and _real(path) in read:
                raise ImageError(f"{path}: is a file that the render reads; give another name")

    def _all(self) -> tuple[Path | None, ...]:
        return (*self.pictures, *self.partial, *self.denoised, self.checkpoint, self.stats)

    def write(self, image: Image) -> None:
        """Write pictures and statistics. An older picture stays where this one has pixels without
        samples, and the name says that it is a part."""
        empty = image.stats.get("pixels_without_samples", 0)
        paths = self.partial if empty else self.pictures
        for path in paths:
            image.save(path)
        if self.stats:
            with atomic_path(self.stats) as temporary:
                temporary.write_text(json.dumps(image.stats, indent=2) + "\n", encoding="utf-8")
        if self.denoised and not empty:
            from furcl.image.denoise import denoised

            preview = denoised(image)
            for path in self.denoised:
                preview.save(path)
            paths += self.denoised
        log.info("wrote %s", ", ".join(map(str, paths)))
        if empty:
            log.warning(
                "%d pixels have no samples: they are black, with alpha 0, and %s is left as it was",
                empty,
                self.pictures[0],
            )


def _real(path: Path) -> str:
    return os.path.realpath(path)
