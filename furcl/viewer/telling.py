"""What pages are told: the state of the view as JSON, and facts beside a picture."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from furcl.scene.camera import Camera
from furcl.scene.tables import Film
from furcl.viewer import camera as cameras
from furcl.viewer.fields import materials
from furcl.viewer.picture import Moments
from furcl.viewer.settings import Settings

Kind = Literal["state", "picture A", "picture B", "lobes", "error"]


def json(value: Any) -> str:
    """A message of JSON values."""
    return msgspec.json.encode(value).decode()


def error(exception: Exception, *, fatal: bool = False) -> str:
    """The message of an error; after a fatal one nothing is rendered any more."""
    return json({"type": "error", "text": str(exception), "fatal": fatal})


def state(settings: Settings, camera: Camera | None, **facts: Any) -> str:
    """The message of what is being shown."""
    film = settings.scene.film
    return json(
        {
            "type": "state",
            "scene": settings.original.name,
            "size": [film.width, film.height],
            "crop": film.crop,
            "exposure_stops": film.exposure_stops,
            "spp": settings.scene.render.spp,
            "camera": None if camera is None else cameras.angles(camera),
            "moved": settings.camera is not None,
            "changed": settings.changed_keys(),
            "materials": materials(settings.scene),
            **facts,
        }
    )


def picture_facts(
    moments: Moments, film: Film, spp: int, rate: float, *, coarse: bool
) -> dict[str, Any]:
    """What is told of a picture: where it lies in the whole one, how far it is, and its noise.

    Parameters
    ----------
    film : Film     what is rendered; the picture has less pixels where it is coarse
    spp : int       samples that it will have
    rate : float    paths a second
    """
    window = film.window
    missing = max(spp - float(moments.samples.mean()), 0.0) * window.n_pixels
    return {
        "type": "picture",
        "box": window.box,
        "full": [window.full_width, window.full_height],
        "coarse": coarse,
        "samples": 0 if coarse else moments.whole_samples,
        "spp": spp,
        "left_s": None if coarse else missing / max(rate, 1.0),
        "noise": None if coarse else moments.noise,
    }
