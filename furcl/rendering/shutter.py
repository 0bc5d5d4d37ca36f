"""What moves while the shutter is open, as kernels/include/camera/shutter.clh reads it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from furcl.scene.camera import Camera


def shutter_words(camera: Camera, times: Sequence[float]) -> NDArray[np.float32]:
    """The buffer `shutter`: the times of groom and camera as parts of the shutter's, and where the
    camera is.

    Parameters
    ----------
    camera : Camera     resolved
    times : floats      of the groom's time steps, the first and the last those of the shutter; none
                        of one that keeps still
    """
    opens, closes = camera.shutter
    words = [(time - opens) / (closes - opens) for time in times]
    places = camera.places
    if len(places) > 1:
        words += [part for part, _ in places]
        for _, still in places:
            assert still.origin is not None
            assert still.target is not None
            words += [*still.origin, *still.target, *still.up]
    return np.array(words, np.float32)
