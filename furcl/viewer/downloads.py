"""Files that a page saves: the scene and the picture."""

from __future__ import annotations

import asyncio
import re
import tempfile
from pathlib import Path

from furcl.image.image import Image
from furcl.viewer.session import Session

EXR = "image/x-exr"
PNG = "image/png"
TOML = "application/toml"


async def download(session: Session, name: str) -> tuple[bytes, str, str] | None:
    """Content, type and name of a file that is made of the session; None if it has none of that
    name.

    Raises
    ------
    FurclError      there is no picture yet
    """
    if name == "scene.toml":
        text = await asyncio.wrap_future(session.scene_text())
        return text.encode(), TOML, f"{_stem(session)}.toml"
    if name not in ("picture.exr", "picture.png"):
        return None
    image = await asyncio.wrap_future(session.picture())
    if name == "picture.png":
        return await asyncio.to_thread(image.png_bytes), PNG, f"{_stem(session)}.png"
    return await asyncio.to_thread(_exr, image), EXR, f"{_stem(session)}.exr"


def _stem(session: Session) -> str:
    """A file's name that needs no quotes."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", session.name).strip("_") or "scene"


def _exr(image: Image) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.exr"
        image.save(path)
        return path.read_bytes()
