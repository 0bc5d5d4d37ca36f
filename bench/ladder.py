"""The ladder of bench/ablation.sh and bench/unbiased.py: which steps away from a conventional
renderer are tried, in which scenes and lights, and the variants that follow from them.

python bench/ladder.py lights               the lights, a line each
python bench/ladder.py light NAME           options of furcl that turn the light of the scenes on
python bench/ladder.py variants [LIGHT]     options of furcl that name the variants, a line each
python bench/ladder.py ends                 the same of the baseline and of furcl at its best alone
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from furcl.bench.convergence_variants import Variant
from furcl.errors import BenchError
from furcl.scene.read import load_scene
from furcl.scene.tables import Render

# What is to be edited: values of keys of [render]. A step that this furcl does not know is left out
# and said so; so are keys of the baseline, whose values are then the only ones there are.
BASELINE = {
    "sampling": "uniform-h",
    "light_sampling": "bcsdf",
    "sequence": "independent",
    "roulette": "depth",
    "roulette_depth": "8",
    "allocation": "even",
}
STEPS = {
    "light samples": {"light_sampling": "mis"},
    "roulette": {"roulette": "adjoint", "roulette_depth": "0"},
    "Sobol": {"sequence": "sobol"},
    "adaptive": {"allocation": "adaptive"},
}
# The sampler whose gain is asked for in every rung, beside that of the baseline.
PROPOSED = {"sampling": "attenuation-cdf"}

SCENES = ("black_hair", "white_hair", "raccoon")
IMAGES = Path(os.environ.get("LIGHTS", "../shared/data/env"))
LIGHTS: dict[str, tuple[str, ...]] = {
    "sky": (),
    "sun": ("environment.sun_radius_deg=0.27",),
    "even": ('environment={kind="constant"}',),
    **{
        name: (f'environment={{kind="image", file="out/lights/{name}.exr"}}',)
        for name in ("studio", "sunrise", "forest")
    },
}
# Lights with every rung, and the proposed sampler in each; in the others each step alone and all of
# them, and the proposed sampler in the first and the last.
WHOLE = ("sky",)

FIRST, LAST, SHIPPED = "baseline", "all", "default"
WITHOUT = f"{LAST} - "
SUFFIX = " (proposed)"


def known(settings: Mapping[str, str]) -> str | None:
    """Why a scene refuses values of [render]; None if it knows them."""
    words = " ".join(f"{key}={value}" for key, value in settings.items())
    try:
        Variant.parse(f"step: {words}").scene(load_scene("single_fibre"))
    except BenchError as error:
        return str(error).partition(" Known are")[0]
    return None


def known_steps() -> tuple[dict[str, str], dict[str, dict[str, str]], list[str]]:
    """Baseline and steps as far as this furcl knows them, and what was left out, with reasons."""
    left_out = []
    base = {}
    for key, value in BASELINE.items():
        refused = known({key: value})
        if refused is None:
            base[key] = value
        else:
            left_out.append(f"{key}={value} of the baseline: {refused}")
    steps = {}
    for name, settings in STEPS.items():
        refused = known(settings)
        if refused is None:
            steps[name] = settings
        else:
            left_out.append(f"step {name!r}: {refused}")
    return base, steps, left_out


def rungs(
    base: Mapping[str, str], steps: Mapping[str, Mapping[str, str]]
) -> dict[str, dict[str, str]]:
    """Name -> settings: the baseline, each step alone, all steps without each, all.

    One that has the settings of another is left out; the first and the last never are.
    """

    def with_steps(names: Iterable[str]) -> dict[str, str]:
        found = dict(base)
        for name in names:
            found |= steps[name]
        return found

    ends = {FIRST: with_steps(()), LAST: with_steps(steps)}
    found = {FIRST: ends[FIRST]}
    between = {f"+ {name}": with_steps([name]) for name in steps}
    between |= {WITHOUT + name: with_steps(n for n in steps if n != name) for name in steps}
    for name, settings in between.items():
        if settings not in (*found.values(), ends[LAST]):
            found[name] = settings
    return {**found, LAST: ends[LAST]}


def variants(light: str = "sky") -> list[str]:
    """Texts of all variants in a light, the baseline first, those of the proposed sampler beside
    those of the baseline's; last what furcl does unless told otherwise."""
    base, steps, _ = known_steps()
    whole = light in WHOLE
    found = []
    for name, settings in rungs(base, steps).items():
        if not whole and name.startswith(WITHOUT):
            continue
        found.append((name, settings))
        if whole or name in (FIRST, LAST):
            found.append((name + SUFFIX, {**settings, **PROPOSED}))
    return [_text(name, settings) for name, settings in [*found, (SHIPPED, shipped())]]


def shipped() -> dict[str, str]:
    """What furcl does unless told otherwise, of the keys of the ladder."""
    keys = {key: None for settings in (BASELINE, *STEPS.values()) for key in settings}
    values = {key: getattr(Render(), key, None) for key in keys}
    return {key: str(value) for key, value in values.items() if value is not None}


def ends() -> list[str]:
    """Texts of the baseline and of what furcl does unless told otherwise, in both allocations."""
    base, _, _ = known_steps()
    best = {kind: {**shipped(), "allocation": kind} for kind in ("even", "adaptive")}
    return [_text(name, settings) for name, settings in {FIRST: base, **best}.items()]


def _text(name: str, settings: Mapping[str, str]) -> str:
    return f"{name}: {' '.join(f'{key}={value}' for key, value in settings.items())}"


def missing(light: str) -> str | None:
    """Why a light cannot be measured; None if it can."""
    if light not in LIGHTS:
        return f"no light {light}; there are {', '.join(LIGHTS)}"
    name = f"{light}.exr"
    if any(name in setting for setting in LIGHTS[light]) and not (IMAGES / name).is_file():
        return f"no {IMAGES / name}; LIGHTS names the folder of the images"
    return None


def settings_of(light: str) -> tuple[str, ...]:
    """Overrides of a scene that give it a light; images are linked to from out/lights.

    Raises
    ------
    BenchError      a light that is not known, or whose image is not there
    """
    refused = missing(light)
    if refused:
        raise BenchError(refused)
    image = IMAGES / f"{light}.exr"
    if any(image.name in setting for setting in LIGHTS[light]):
        link = Path("out/lights") / image.name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(image.resolve())
    return LIGHTS[light]


def _lines(words: list[str]) -> Iterator[str]:
    what, *names = words or [""]
    if what == "lights":
        yield from LIGHTS
    elif what == "light" and names:
        for setting in settings_of(names[0]):
            yield from ("--set", setting)
    elif what == "ends":
        for text in ends():
            yield from ("--variant", text)
    elif what == "variants":
        for reason in known_steps()[2]:
            print(f"left out: {reason}", file=sys.stderr)
        for text in variants(*names):
            yield from ("--variant", text)
    else:
        raise BenchError((__doc__ or "").partition("\n\n")[2])


if __name__ == "__main__":
    try:
        for line in _lines(sys.argv[1:]):
            print(line)
    except BenchError as error:
        sys.exit(str(error))
