"""What a page asks for: messages as JSON, told apart by their key `do`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from furcl.errors import SceneError

Angle = Annotated[float, Meta(ge=-360.0, le=360.0)]
Part = Annotated[float, Meta(ge=-10.0, le=10.0)]
Pixel = Annotated[int, Meta(ge=0, le=16384)]
SlotName = Literal["A", "B"]


class _Message(msgspec.Struct, frozen=True, tag_field="do", forbid_unknown_fields=True):
    pass


class Orbit(_Message, frozen=True, tag="orbit"):
    """Turn the camera around its target: counterclockwise seen from above, and upwards [deg]."""

    azimuth_deg: Angle
    elevation_deg: Angle


class Move(_Message, frozen=True, tag="move"):
    """Move camera and target to the right and upwards, in heights of what is seen there."""

    right: Part
    up: Part


class Dolly(_Message, frozen=True, tag="dolly"):
    """Multiply the distance to the target, or the height that an orthographic camera sees."""

    factor: Annotated[float, Meta(ge=0.01, le=100.0)]


class ResetCamera(_Message, frozen=True, tag="reset-camera"):
    """The scene's camera again."""


class Set(_Message, frozen=True, tag="set"):
    """Give a key of the scene a value, as `--set` does."""

    key: Annotated[str, Meta(min_length=1, max_length=200)]
    value: Any


class Reset(_Message, frozen=True, tag="reset"):
    """Give a key the value that it has in the scene's file; without a key, all of them."""

    key: Annotated[str, Meta(min_length=1, max_length=200)] | None = None


class Crop(_Message, frozen=True, tag="crop"):
    """Render a window of the picture, left, top, right, bottom [pixels]; None: all of it."""

    box: tuple[Pixel, Pixel, Pixel, Pixel] | None


class Choose(_Message, frozen=True, tag="slot"):
    """Go on with the settings A or B."""

    slot: SlotName


class Copy(_Message, frozen=True, tag="copy"):
    """Make the other settings those that are shown."""


class Pause(_Message, frozen=True, tag="pause"):
    """Stop rendering, or go on."""

    on: bool


Message = Orbit | Move | Dolly | ResetCamera | Set | Reset | Crop | Choose | Copy | Pause

_decoder = msgspec.json.Decoder(Message)


def decode(text: str | bytes) -> Message:
    """The message of a page.

    Raises
    ------
    SceneError      no JSON, an unknown message, or a value outside its range
    """
    try:
        return _decoder.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise SceneError(f"message of the page: {error}; reload the page") from None
