"""Renders that several devices or machines share, and the samples that one of them takes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from furcl.image.image import Image
    from furcl.scene.tables import Scene


@dataclass(frozen=True)
class Shared:
    """Who shares a render.

    Attributes
    ----------
    device : str or None        several devices of this machine, or that of each worker
    dask : str or None          address of a scheduler
    part_spp : int or None      samples a pixel of a part
    """

    device: str | None
    dask: str | None
    part_spp: int | None

    @staticmethod
    def of(device: str | None, dask: str | None, part_spp: int | None) -> Shared | None:
        """Those of the options; None where one device renders."""
        several = False
        if device is not None:
            from furcl.device.several import names_several  # loads OpenCL

            several = names_several(device)
        if dask is None and not several:
            if part_spp is not None:
                raise typer.BadParameter("--part-spp is of renders that several devices share")
            return None
        if dask is not None and several:
            raise typer.BadParameter(
                f"--device {device} with --dask: a worker has one device; start a worker for each"
            )
        return Shared(device, dask, part_spp)

    def check(self, options: Mapping[str, object]) -> None:
        """Refuse options that need one device; typer.BadParameter."""
        given = [name for name, value in options.items() if value is not None]
        if given:
            raise typer.BadParameter(
                f"{', '.join(given)}: needs one device; name one with --device, without --dask"
            )

    def render(self, scene: Scene, **common: Any) -> Image:
        """Render; `common` is what all ways to render take."""
        if self.dask is not None:
            from furcl.distributed.cluster import render

            return render(scene, self.dask, device=self.device, part_spp=self.part_spp, **common)
        from furcl.distributed.devices import render_on

        assert self.device is not None
        return render_on(scene, self.device, part_spp=self.part_spp, **common)


def sample_range(text: str | None) -> tuple[int, int] | None:
    """The samples of FIRST:END; typer.BadParameter for another text."""
    if text is None:
        return None
    numbers = re.fullmatch(r"(\d{1,10}):(\d{1,10})", text.strip())
    if not numbers:
        raise typer.BadParameter(
            f"--samples {text}: expected FIRST:END, as in 0:64; END is the first sample that is "
            f"not taken"
        )
    return int(numbers[1]), int(numbers[2])
