"""Scenes whose every value is drawn from all of its range: no NaN, no crash, and black pictures
that `furcl info` explains.

`python -m faults.random_scenes FIRST N` renders scenes FIRST to FIRST + N - 1, each a function of
its number.
"""

from __future__ import annotations

import json
import sys
import time
import types
import typing
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Union

import msgspec
import numpy as np
from msgspec import Meta

from faults.case import Case
from faults.harness import environment, run
from furcl.device.layout import LAYERS

N_FULL, N_QUICK = 600, 3
SLOW_S = 30.0
# What would only take long: work goes with these, and their ranges are tried elsewhere.
_SMALL = {
    "width": (4, 16), "height": (4, 16), "spp": (1, 4), "n_strands": (1, 400), "count": (1, 400),
    "n_points": (2, 24), "n_clumps": (0, 30),
}  # fmt: skip
_ALWAYS = {*_SMALL, "sigma_ca", "sigma_a"}
_LEFT_OUT = {"name", "file", "origin", "preset", "melanin", "colour", "reflectance", "sampling"}
_CHANCE = 0.5
AMPLIFIES = "more light leaves it than meets it"


def _number(low: float, high: float, whole: bool, rng: np.random.Generator) -> float | int:
    """From a range: an end, evenly, or evenly by its logarithm, from both sides of 0."""
    kind = rng.random()
    if kind < 0.1:
        value = low if rng.random() < 0.5 else high
    elif kind < 0.5:
        value = rng.uniform(low, high)
    else:
        largest = max(abs(low), abs(high))
        value = largest * 10.0 ** rng.uniform(-12.0, 0.0)
        value = min(max(-value if rng.random() < 0.5 and low < 0.0 else value, low), high)
    return round(value) if whole else float(value)


def _value(name: str, hint: Any, allowed: Any, rng: np.random.Generator) -> Any:
    """A value of a type, or None where there is no telling which are allowed."""
    if isinstance(allowed, tuple) and not isinstance(allowed[0], str):
        one = partial(_number, *allowed, False, rng)
        takes_three = "tuple" in str(hint)
        return [one() for _ in range(3)] if takes_three and rng.random() < 0.5 else one()
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (Union, types.UnionType):
        parts = [part for part in parts if part is not type(None)]
        return _value(name, parts[rng.integers(len(parts))], None, rng)
    if origin is Literal:
        return parts[rng.integers(len(parts))]
    if origin is tuple:
        return [_value(name, part, None, rng) for part in parts]
    if hint is bool:
        return bool(rng.random() < 0.5)
    if origin is Annotated and parts[0] in (int, float):
        metas = [meta for meta in parts[1:] if isinstance(meta, Meta)]
        low = next((m.ge if m.ge is not None else m.gt for m in metas), None)
        high = next((m.le if m.le is not None else m.lt for m in metas), None)
        if low is None or high is None:
            return None
        if any(m.gt is not None for m in metas):
            low = low + 1e-12 * high
        return _number(*_SMALL.get(name, (low, high)), parts[0] is int, rng)
    if origin is Annotated:
        return _value(name, parts[0], None, rng)
    return None


def _table(table: type[msgspec.Struct], rng: np.random.Generator) -> dict[str, Any]:
    """Some of the keys of a table."""
    config = table.__struct_config__
    found: dict[str, Any] = {config.tag_field: config.tag} if config.tag_field else {}
    allowed = getattr(table, "allowed", {})
    for field in msgspec.structs.fields(table):
        wanted = field.name in _ALWAYS or field.required or rng.random() < _CHANCE
        if field.name in _LEFT_OUT or not wanted:
            continue
        value = _value(field.name, field.type, allowed.get(field.name), rng)
        if value is not None:
            found[field.name] = value
    return found


NEED_FILES = ("file", "image", "interpolate")


def document(number: int) -> dict[str, Any]:
    """The scene of a number."""
    from furcl.scene.tables import KINDS, Scene

    rng = np.random.default_rng([20, number])
    fields = {field.name: field.type for field in msgspec.structs.fields(Scene)}
    found: dict[str, Any] = {"name": f"random {number}"}
    for name in ("camera", "film", "render"):
        found[name] = _table(fields[name], rng)
    found["camera"].pop("target", None)
    orthographic = found["camera"].get("projection") == "orthographic"
    found["camera"].pop("vfov_deg" if orthographic else "height", None)
    if "height" in found["camera"]:
        found["camera"].pop("margin", None)
    found["camera"].pop("keys", None)  # a list of tables
    if "shutter" in found["camera"]:
        found["camera"]["shutter"].sort()
    # Crops within the picture, and layers of the list, have no range of numbers to draw from.
    found["film"].pop("crop", None)
    found["film"].pop("camera", None)
    layers = rng.choice(LAYERS, 2, replace=False).tolist() if rng.random() < 0.3 else []
    found["film"]["layers"] = layers
    if rng.random() < 0.3:  # anywhere, or within a few sizes of most grooms
        for key in ("origin", "target"):
            scale = 1e9 if rng.random() < 0.2 else 3.0
            found["camera"][key] = rng.uniform(-scale, scale, 3).tolist()
        for key in ("azimuth_deg", "elevation_deg", "margin"):  # of automatic framing
            found["camera"].pop(key, None)
    for name, kinds in KINDS.items():
        tables = {k: t for k, t in kinds.tables().items() if k not in NEED_FILES}
        if name in ("fibre", "environment", "curves") or (name == "body" and rng.random() < 0.3):
            found[name] = _table(tables[list(tables)[rng.integers(len(tables))]], rng)
    if found["curves"]["generator"] == "hair":
        # The points of a strand follow from its waves, and are too many of most of their ranges.
        for key in ("n_points", "wave_frequency", "length", "scalp_radii"):
            found["curves"].pop(key, None)
    found["render"].pop("variance", None)  # adaptive allocation needs it
    for key in ("mode", "scattering"):  # which some models have not
        found["fibre"].pop(key, None)
    return found


def main() -> None:
    """Render them and print a line for each that is black, slow, refused or wrong; and counts."""
    from furcl.cli.warnings import of_scene
    from furcl.errors import FurclError
    from furcl.rendering.renderer import render
    from furcl.scene.read import decode_scene

    first, n = int(sys.argv[1]), int(sys.argv[2])
    names = ("rendered", "refused", "black", "unexplained", "wrong", "amplified", "slow")
    counts = dict.fromkeys(names, 0)
    for number in range(first, first + n):
        print(f"scene {number}", file=sys.stderr, flush=True)
        start = time.monotonic()
        try:
            scene = decode_scene(document(number), "scene")
            curves = scene.build_curves()
            image = render(scene, curves=curves)
        except FurclError as error:
            counts["refused"] += 1
            print(f"scene {number} refused: {error}", file=sys.stderr)
            continue
        seconds = time.monotonic() - start
        counts["rendered"] += 1
        said = list(of_scene(scene, curves))
        # Where light grows with each bounce samples may leave float32: counted, their pixels NaN.
        nonfinite = image.stats["nonfinite"]
        if nonfinite and any(AMPLIFIES in text for text in said):
            counts["amplified"] += 1
            print(f"scene {number} amplified: {said}", file=sys.stderr)
        elif nonfinite or not np.isfinite(image.rgb).all():
            counts["wrong"] += 1
            print(f"scene {number} wrong: {nonfinite} samples", file=sys.stderr)
        if seconds > SLOW_S:
            counts["slow"] += 1
            print(f"scene {number} slow: {seconds:.0f} s; {said}", file=sys.stderr)
        if not image.rgb.any():
            counts["black"] += 1
            counts["unexplained"] += not said
            print(f"scene {number} black: {said}", file=sys.stderr)
    print(json.dumps(counts))


def _random(folder: Path, quick: bool) -> str:
    n = N_QUICK if quick else N_FULL
    command = [sys.executable, "-P", "-m", "faults.random_scenes", "0", str(n)]
    ended = run(command, environment())
    last = ended.err.strip().splitlines()[-1][:150] if ended.err.strip() else ""
    assert ended.code == 0, f"code {ended.code}: {last}"
    counts = json.loads(ended.out.strip().splitlines()[-1])
    told = ", ".join(f"{number} {name}" for name, number in counts.items())
    assert counts["wrong"] == 0, told
    assert counts["rendered"] > 0.5 * n, told
    assert counts["unexplained"] == 0, told
    return told


CASES = [Case("random scenes within all ranges", _random)]

if __name__ == "__main__":
    main()
