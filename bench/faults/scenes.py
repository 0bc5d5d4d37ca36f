"""Scene files and overrides that are none, and arguments that the interface does not take."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import furcl as api
from faults.case import Case
from faults.harness import furcl, refused, told
from furcl.errors import DeviceError, FibreError, GroomError, ResourceError, SceneError
from furcl.scene.read import load_scene

SCENE = "[fibre]\npreset = 'human-black'\n[environment]\nkind = 'constant'\n"
SCENE += "[curves]\ngenerator = 'fibre'\n"

_TEXTS = {
    "lists 100,000 deep": "x = " + "[" * 100_000,
    "inline tables 10,000 deep": "x = " + "{a = " * 10_000,
    "a dotted key of 8000 parts": ".".join(["a"] * 8000) + " = 1",
    "a dotted key of 8000 texts": ".".join(['"a"'] * 8000) + " = 1",
    "a table's name of 8000 parts": "[" + ".".join(["a"] * 8000) + "]",
    "a number of 5000 digits": "[render]\nseed = " + "9" * 5000,
    "a number of 5000 hexadecimal digits": SCENE + "[render]\nseed = 0x" + "f" * 5000,
    "a date that is none": "x = 1979-99-99",
    "2 MB of text": "x = '" + "a" * 2_000_000 + "'",
    "a key of 500,000 letters": "a" * 500_000 + " = 1",
}
_OVERRIDES = {
    "a number of 5000 digits": "render.seed=" + "9" * 5000,
    "a number of 5000 hexadecimal digits": "render.seed=0x" + "f" * 5000,
    "a list 20,000 deep": "film.width=" + "[" * 20_000,
    "a key of 8000 parts": ".".join(["a"] * 8000) + "=1",
    "tables in each other": "film=" + "{a=" * 1000 + "1" + "}" * 1000,
}


def _text(text: str, folder: Path, quick: bool) -> str:
    path = folder / "a.toml"
    path.write_text(text)
    start = time.process_time()
    said = refused(lambda: load_scene(path), SceneError)
    assert time.process_time() - start < 5.0, "takes more than 5 s"
    assert len(said) < 1500, f"a message of {len(said)} letters"
    return said


def _override(override: str, folder: Path, quick: bool) -> str:
    said = refused(lambda: load_scene("single_fibre", overrides=[override]), SceneError)
    assert len(said) < 1500, f"a message of {len(said)} letters"
    return said


def _file(name: str, folder: Path, quick: bool) -> str:
    path = folder / "a.toml"
    path.write_text(SCENE.replace("generator = 'fibre'", f'file = "{name}"'))
    return refused(lambda: load_scene(path), SceneError, "there is no such file")


def _table(folder: Path, quick: bool) -> str:
    path = folder / "a.toml"
    path.write_text("film = 3\n" + SCENE)
    return refused(lambda: load_scene(path), SceneError, "width", "filter_radius_px")


def _endless(folder: Path, quick: bool) -> str:
    ended = furcl("render", "/dev/zero", "-o", folder / "a.exr")
    assert ended.peak_bytes < 300e6, f"{ended.peak_bytes / 1e6:.0f} MB"
    return told(ended, 2)


def _render(error: type, options: dict[str, Any], folder: Path, quick: bool) -> str:
    options = {"scene": "single_fibre", "spp": 1, **options}
    return refused(lambda: api.render(options.pop("scene"), **options), error)


_RENDER: dict[str, tuple[type, dict[str, Any]]] = {
    "render(None)": (SceneError, {"scene": None}),
    "render(3)": (SceneError, {"scene": 3}),
    "device = 5": (DeviceError, {"device": 5}),
    "curves = 'x.hair'": (GroomError, {"curves": "x.hair"}),
    "wave_size = 1.5": (ResourceError, {"wave_size": 1.5}),
    "wave_size = '3'": (ResourceError, {"wave_size": "3"}),
    "wave_size = 2^33": (ResourceError, {"wave_size": 2**33}),
    "wave_size = True": (ResourceError, {"wave_size": True}),
    "time_limit = 'x'": (SceneError, {"time_limit": "x"}),
    "time_limit = nan": (SceneError, {"time_limit": float("nan")}),
    "time_limit = -1": (SceneError, {"time_limit": -1.0}),
    "progress = 3": (SceneError, {"progress": 3}),
    "spp = 10^5000": (SceneError, {"spp": 10**5000}),
    "spp = [1]": (SceneError, {"spp": [1]}),
    "sampling = 5": (SceneError, {"sampling": 5}),
}


def _probes(call: Callable[[api.Probe], object], folder: Path, quick: bool) -> str:
    probe = api.Probe(api.Fibre.preset("human-black"), light_sampling=True)
    return refused(lambda: call(probe), (FibreError, ResourceError))


_WO = np.array([0.0, 0.0, 1.0])
_PROBES: dict[str, Callable[[api.Probe], object]] = {
    "seed = -1": lambda p: p.sample(_WO, 4, seed=-1),
    "seed = 2^32": lambda p: p.sample(_WO, 4, seed=2**32),
    "seed = 1.5": lambda p: p.sample(_WO, 4, seed=1.5),  # pyright: ignore[reportArgumentType]
    "n = -1": lambda p: p.sample(_WO, -1),
    "lobe 7 of pdf": lambda p: p.pdf(_WO, _WO, 0.0, 7),
    "lobe 7 of evaluate": lambda p: p.evaluate(_WO, _WO, 0.0, 7),
    "lobe -1 of direction_pdf": lambda p: p.direction_pdf(_WO, _WO, 0.0, -1),
    "numbers of 1": lambda p: p.sample(_WO, 4, numbers=np.ones((4, 2, 4))),
    "numbers of nan": lambda p: p.sample(_WO, 4, numbers=np.full((4, 2, 4), np.nan)),
    "numbers of another shape": lambda p: p.sample(_WO, 4, numbers=np.zeros((4, 3))),
    "numbers that are text": lambda p: p.sample(_WO, 4, numbers=[["x"]]),
    "3 * 10^8 samples": lambda p: p.sample(_WO, 3 * 10**8),
    "10^12 samples": lambda p: p.sample(_WO, 10**12),
    "channels = 7": lambda p: api.Probe(p.fibre, device=p.device, channels=7),
    "channels = 1 of a coloured fibre": lambda p: api.Probe(
        api.Fibre(sigma_ca=(1.0, 2.0, 3.0)), device=p.device, channels=1
    ),
    "h = 5": lambda p: p.evaluate(_WO, _WO, 5.0),
    "h = nan": lambda p: p.pdf(_WO, _WO, float("nan")),
    "h of two sizes": lambda p: p.evaluate(np.tile(_WO, (3, 1)), _WO, [0.0, 0.1]),
    "h in two dimensions": lambda p: p.evaluate(_WO, _WO, np.zeros((2, 3))),
    "ragged h": lambda p: p.evaluate(_WO, _WO, [[0.0], [0.0, 0.1]]),
    "theta_in in two dimensions": lambda p: p.attenuation(0.0, np.zeros((2, 3))),
    "theta_in = 2": lambda p: p.attenuation(0.0, 2.0),
    "theta_in = nan": lambda p: p.attenuation(0.0, float("nan")),
    "theta_in of words": lambda p: p.attenuation(0.0, "x"),
    "wo of complex numbers": lambda p: p.sample(_WO * 1j, 4),
    "wo of length 2": lambda p: p.sample(2.0 * _WO, 4),
    "wo of nan": lambda p: p.sample(np.nan * _WO, 4),
    "wo of two numbers": lambda p: p.sample(_WO[:2], 4),
    "7 wo and 9 wi": lambda p: p.evaluate(np.tile(_WO, (7, 1)), np.tile(_WO, (9, 1)), 0.0),
    "7 wo and 9 wi of light": lambda p: p.estimate_far_field(
        np.tile(_WO, (7, 1)), np.tile(_WO, (9, 1))
    ),
    "seed = -1 of light": lambda p: p.estimate_far_field(_WO, _WO, seed=-1),
}

CASES = [
    *(Case(f"a scene of {name}", partial(_text, text)) for name, text in _TEXTS.items()),
    *(Case(f"--set with {name}", partial(_override, text)) for name, text in _OVERRIDES.items()),
    Case("curves.file with a zero", partial(_file, "a\\u0000.hair")),
    Case("curves.file of 5000 letters", partial(_file, "a" * 5000 + ".hair")),
    Case("a number where a table is wanted", _table),
    Case("a scene without an end", _endless),
    *(Case(name, partial(_render, *given)) for name, given in _RENDER.items()),
    *(Case(f"Probe: {name}", partial(_probes, call)) for name, call in _PROBES.items()),
]
