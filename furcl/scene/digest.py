"""Short names of what a picture follows from, for caches and for renders that go on."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import msgspec
import numpy as np

from furcl.groom.curves import Curves
from furcl.groom.joined import Grooms
from furcl.scene.schema import files_in
from furcl.scene.tables import Scene


def digest(*parts: object) -> str:
    """A short hash of texts, bytes and JSON values."""
    state = hashlib.sha256()
    for part in parts:
        raw = part if isinstance(part, bytes) else json.dumps(part, sort_keys=True).encode()
        state.update(len(raw).to_bytes(8, "little") + raw)
    return state.hexdigest()[:20]


def scene_digest(scene: Scene, curves: Curves | Grooms | None = None) -> str:
    """A hash of all that the picture of a scene follows from, but the table [render].

    Parameters
    ----------
    curves : Curves, Grooms or None     the scene's groom or grooms, where they are there already
    """
    document = msgspec.to_builtins(scene)
    del document["render"], document["name"], document["film"]["exposure_stops"]
    grooms = scene.build_grooms() if curves is None else Grooms.of(curves)
    whole = grooms.curves
    arrays = [whole.points if whole.steps is None else whole.steps, whole.radii, whole.offsets]
    arrays += [np.array(whole.times)] if whole.times else []
    arrays += [array for groom in grooms.grooms for array in groom.curves.attributes.values()]
    parts: list[object] = [np.ascontiguousarray(array).tobytes() for array in arrays]
    for keys, table in list(files_in(document)):
        # What is in a file counts, not where it lies; the groom's is in the arrays.
        name = table.pop(keys[-1])
        if keys[0] != "curves" and not (keys[0] == "groom" and "curves" in keys[2:]):
            parts.append(Path(name).read_bytes())
    return digest(document, *parts)
