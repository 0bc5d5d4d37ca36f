"""What a convergence run compares: variants of a scene, each some values of [render] and [film]."""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import msgspec
from msgspec import json

from furcl.device.features import Features
from furcl.errors import BenchError, SamplerError, SceneError
from furcl.scene.read import with_overrides
from furcl.scene.schema import fields
from furcl.scene.tables import Film, Render, Scene

TABLES = {"render": Render, "film": Film}
EXAMPLE = '"mine: sampling=full-cdf light_sampling=mis"'

# Names are parts of file names.
_NAME = re.compile(r"[\w+.()=-]+( [\w+.()=-]+)*")
_PLANNED = {
    "render.spp": "--spp says which numbers of samples are compared",
    "render.seed": "--seed is the one that all seeds follow from",
    "film.width": "--size is one for all variants, as the reference is",
    "film.height": "--size is one for all variants, as the reference is",
}

# Where samples are drawn otherwise, a pixel's own variance is not its error, nor the slope 1/2.
_INDEPENDENT = {"sequence": "independent", "allocation": "even"}
# Keys that change what is estimated, and not only how.
_OF_THE_PICTURE = (
    ("film", "filter"),
    ("film", "filter_radius_px"),
    ("render", "max_depth"),
    ("render", "residual"),
)

# What "auto" became, of a scene whose kernels have these features: one line a key of [render].
CHOSEN: Mapping[str, Callable[[Features], str]] = {
    "light_sampling": lambda features: "mis" if features.light_sampling else "bcsdf",
}


@dataclass(frozen=True)
class Variant:
    """One thing to compare.

    Attributes
    ----------
    name : str                  in tables, plots and names of files
    settings : tuple of str     "render.key=VALUE" or "film.key=VALUE"; the scene's own values hold
                                for all other keys
    """

    name: str
    settings: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> Self:
        """A variant of "NAME: key=VALUE key=VALUE ...", with keys of [render] and [film].

        Values with spaces stand in quotes. A key may be given with its table, `film.filter=box`.

        Raises
        ------
        BenchError      no name, a name that is none for a file, what is no key=VALUE, a key twice
                        or one that is the same for all variants
        """
        name, colon, rest = text.partition(":")
        name = name.strip()
        if not colon or not _NAME.fullmatch(name):
            raise BenchError(
                f"variant {text!r}: expected NAME: key=VALUE ..., the name of letters, digits, "
                f"single spaces and _ + - . ( ) =, for example {EXAMPLE}"
            )
        try:
            words = shlex.split(rest)
        except ValueError as error:
            raise BenchError(f"variant {name!r}: {error}; close the quotes") from None
        settings: dict[str, str] = {}
        for word in words:
            key, equals, value = word.partition("=")
            if not equals or not key or not value:
                raise BenchError(
                    f"variant {name!r}: {word!r}: expected key=VALUE, for example {EXAMPLE}"
                )
            dotted = _dotted(key, name)
            if dotted in _PLANNED:
                raise BenchError(
                    f"variant {name!r}: {dotted} is not a variant's: {_PLANNED[dotted]}"
                )
            if dotted in settings:
                raise BenchError(f"variant {name!r}: {dotted} is given twice; keep one")
            settings[dotted] = value
        return cls(name, tuple(f"{key}={value}" for key, value in settings.items()))

    @classmethod
    def of_sampler(cls, name: str) -> Self:
        """The variant of a sampler, under its name; SamplerError if there is none."""
        return cls(name, (f"render.sampling={name}",))

    def scene(self, scene: Scene) -> Scene:
        """The scene with the settings of this variant.

        Raises
        ------
        BenchError      names the variant, and says of a key or value what `furcl.load_scene` says
        """
        try:
            return with_overrides(scene, self.settings)
        except (SceneError, SamplerError) as error:
            raise BenchError(f"variant {self.name!r}: {error}") from None

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {"name": self.name, "settings": list(self.settings)}


def _dotted(key: str, name: str) -> str:
    """A key with its table. One that no table has gets the table with the most similar key, whose
    message then says what is known."""
    first, dot, _ = key.partition(".")
    if dot and first in TABLES:
        return key
    owners = {field: table for table in reversed(TABLES) for field in fields(TABLES[table])}
    if dot and (first not in owners or first in fields(Scene)):
        raise BenchError(
            f"variant {name!r}: {key}: variants change keys of [render] and [film] only; --set "
            f"{key}=VALUE changes the scene for all of them"
        )
    near = difflib.get_close_matches(first, owners, 1, 0.6)
    return f"{owners[near[0]] if near else 'render'}.{key}"


def settings_of(scene: Scene) -> dict[str, Any]:
    """Values of [render] and [film] as a render has them, without those of the plan."""
    # As JSON has them: lists for tuples.
    tables = {name: json.decode(json.encode(getattr(scene, name))) for name in TABLES}
    for dotted in _PLANNED:
        table, _, key = dotted.partition(".")
        del tables[table][key]
    return tables


def chosen(scene: Scene, features: Features) -> dict[str, str]:
    """What became of the keys of [render] that say "auto": key -> value."""
    render = msgspec.to_builtins(scene.render)
    return {key: find(features) for key, find in CHOSEN.items() if render.get(key) == "auto"}


def checks(scene: Scene, own: Scene, found: Mapping[str, str]) -> dict[str, str | None]:
    """Which of the benchmark's checks hold for a variant: None, or why one does not.

    Parameters
    ----------
    scene : Scene       without the variant's settings; the reference is of this one
    own : Scene         with them
    found : dict        what `chosen` gave

    Returns
    -------
    dict    slope (RMSE falls with power -1/2 of the samples), own_variance (the MSE is the mean of
            the variance image), mean (of the picture is the reference's)
    """
    render = {**msgspec.to_builtins(own.render), **found}
    dependent = [
        f"{key} = {render[key]}"
        for key, independent in _INDEPENDENT.items()
        if render.get(key, independent) != independent
    ]
    other = [
        f"{key} is not the scene's"
        for table, key in _OF_THE_PICTURE
        if getattr(getattr(scene, table), key) != getattr(getattr(own, table), key)
    ]
    spread = ", ".join([*dependent, *other]) or None
    kept = None if own.render.variance else "variance = false"
    return {"slope": spread, "own_variance": spread or kept, "mean": ", ".join(other) or None}
