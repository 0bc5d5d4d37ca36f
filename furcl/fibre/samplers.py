"""The samplers of the BCSDF by name: those that come with furcl, and a user's own.

A sampler is a file of OpenCL C that chooses the lobe and the offset h
(kernels/include/fibre/sampler.clh says what it defines), and a way to choose the directions of
lobes that have profiles. docs/own_sampler.md has an example.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

from furcl.device.layout import Mode
from furcl.errors import SamplerError
from furcl.files import read_text
from furcl.paths import kernel_folder
from furcl.registry import Registry

FUNCTIONS = ("joint_densities", "sample_lobe_and_offset")
TABLE_FUNCTIONS = (
    "table_rows", "joint_density", "lobe_cdf", "bin_cdf",
    "mixed_density", "lobe_cdf_of", "bin_cdf_of",
)  # fmt: skip

Angles = Literal["uniform", "profile"]


@dataclass(frozen=True)
class Sampler:
    """How lobe, offset h and direction are chosen: the part <sampler> of furcl.device.features.

    Attributes
    ----------
    name : str                      as in `--sampling`
    header : Path                   file with the functions of FUNCTIONS: absolute, or in
                                    kernels/include
    needs_tables : bool             whether the attenuation tables are computed and passed; without
                                    them a text that reads them does not compile
    scattered_angles : str          directions of TT^s and TRT^s: "uniform" over the sphere, or
                                    from their own "profile"
    all_lobes : bool                whether a direction is worth the values of all lobes at its h
                                    over all their densities there, not those of its lobe alone;
                                    of samplers that draw lobes by A_p(h)
    """

    name: str
    header: Path
    needs_tables: bool
    scattered_angles: Angles
    all_lobes: bool = False

    def defines(self) -> dict[str, int | str]:
        """What fibre/sampler.clh and the models test."""
        return {
            "FURCL_TABLES": int(self.needs_tables),
            "FURCL_PROFILE_ANGLES": int(self.scattered_angles == "profile"),
            "FURCL_ALL_LOBES": int(self.all_lobes),
        }

    def structs(self) -> dict[str, Any]:
        """None."""
        return {}

    def as_dict(self) -> dict[str, Any]:
        """Nothing beside the name."""
        return {}

    def text(self) -> str:
        """The text of the file.

        Raises
        ------
        SamplerError    if it cannot be read
        """
        path = kernel_folder() / "include" / self.header
        try:
            return read_text(path)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it is not UTF-8"
            raise SamplerError(
                f"sampler {self.name!r}: {path} cannot be read: {reason}; register the sampler "
                f"with the path of its file"
            ) from None


_UNIFORM, _CDF = Path("samplers/uniform_h.clh"), Path("samplers/attenuation_cdf.clh")
_samplers = Registry(
    "sampler",
    SamplerError,
    {
        "uniform-h": Sampler("uniform-h", _UNIFORM, False, "uniform"),
        "attenuation-cdf": Sampler("attenuation-cdf", _CDF, True, "uniform"),
        "full-cdf": Sampler("full-cdf", _CDF, True, "profile"),
        "all-lobes": Sampler("all-lobes", _UNIFORM, False, "profile", all_lobes=True),
    },
)
BUILT_IN = _samplers.built_in


def names() -> tuple[str, ...]:
    """All samplers that can be asked for, those of furcl first."""
    return _samplers.names()


def find(name: str) -> Sampler:
    """The sampler of a name.

    Raises
    ------
    SamplerError    unknown name, with those that are known
    """
    return _samplers.find(name, f"sampling = {name!r}: allowed are", "furcl.samplers.register")


def in_mode(sampler: Sampler, mode: Mode) -> Sampler:
    """What a sampler is where a fibre's offset h is not anywhere on its width.

    In "multiscale" the built-in ones choose h within the footprint of a pixel, those without tables
    evenly, the others by them. In "near" there is no h to choose: all take lobes by A_p(h) and need
    no tables, "full-cdf" differs by the directions of lobes that have profiles, "all-lobes" by its
    weights too.

    Raises
    ------
    SamplerError    a sampler of one's own, which knows the whole width alone
    """
    if mode != "far" and sampler.name not in BUILT_IN:
        raise SamplerError(
            f"sampler {sampler.name!r} chooses h on the whole width of a fibre, and fibre.mode is "
            f"{mode!r}: allowed are {', '.join(BUILT_IN)}, or mode = 'far'"
        )
    return replace(sampler, header=_UNIFORM, needs_tables=False) if mode == "near" else sampler


def register(
    name: str,
    clh: str | os.PathLike[str],
    *,
    needs_tables: bool | None = None,
    scattered_angles: Angles = "uniform",
) -> Sampler:
    """Make a sampler of one's own usable under a name; one of that name is replaced.

    Parameters
    ----------
    name : str                  for `sampling`, other than those of furcl
    clh : path                  file with the functions of FUNCTIONS; what it includes is sought
                                beside it, then among furcl's kernels
    needs_tables : bool or None compute the attenuation tables and pass them; None: if the text
                                names one of TABLE_FUNCTIONS
    scattered_angles : str      "uniform" or "profile", see `Sampler`

    Raises
    ------
    SamplerError    a name of furcl's own, an unknown kind of angles, or a file that cannot be
                    read or lacks one of the functions
    """
    _samplers.check_name(name)
    if scattered_angles not in get_args(Angles):
        raise SamplerError(
            f"sampler {name!r}: scattered_angles = {scattered_angles!r}; allowed are 'uniform' "
            f"and 'profile'"
        )
    header = Path(clh).absolute()
    words = _samplers.check_header(name, header, FUNCTIONS, "docs/own_sampler.md")
    if needs_tables is None:
        needs_tables = not words.isdisjoint(TABLE_FUNCTIONS)
    sampler = Sampler(name, header, needs_tables, scattered_angles)
    _samplers.add(name, sampler)
    return sampler


def unregister(name: str) -> None:
    """Forget a sampler of one's own; SamplerError if there is none of that name."""
    _samplers.remove(name)
