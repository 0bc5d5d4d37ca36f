"""The samplers of the BCSDF by name: those that come with furcl, and a user's own.

A sampler is a file of OpenCL C that chooses the lobe and the offset h
(kernels/include/fibre/attenuation_tables.clh says what it defines), and a way to choose the
directions of the scattered lobes. docs/own_sampler.md has an example.
"""

from __future__ import annotations

import difflib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from furcl.errors import SamplerError
from furcl.paths import kernel_folder

FUNCTIONS = ("joint_densities", "sample_lobe_and_offset")


@dataclass(frozen=True)
class Sampler:
    """How lobe, offset h and direction are chosen.

    Attributes
    ----------
    name : str                      as in `--sampling`
    clh : Path                      file with the functions of FUNCTIONS
    needs_tables : bool             whether the attenuation tables are computed and passed
    scattered_angles : str          directions of TT^s and TRT^s: "uniform" over the sphere, or
                                    from their own "profile"
    """

    name: str
    clh: Path
    needs_tables: bool
    scattered_angles: Literal["uniform", "profile"]

    def source(self) -> str:
        """The text of the file.

        Raises
        ------
        SamplerError    if it cannot be read
        """
        try:
            return self.clh.read_text()
        except OSError as error:
            raise SamplerError(
                f"sampler {self.name!r}: {self.clh} cannot be read: {error.strerror}; "
                f"register the sampler with the path of its file"
            ) from None


def _built_in() -> dict[str, Sampler]:
    folder = kernel_folder() / "include" / "samplers"
    uniform, cdf = folder / "uniform_h.clh", folder / "attenuation_cdf.clh"
    return {
        "uniform-h": Sampler("uniform-h", uniform, False, "uniform"),
        "attenuation-cdf": Sampler("attenuation-cdf", cdf, True, "uniform"),
        "full-cdf": Sampler("full-cdf", cdf, True, "profile"),
    }


BUILT_IN = ("uniform-h", "attenuation-cdf", "full-cdf")
_registered = _built_in()


def names() -> tuple[str, ...]:
    """All samplers that can be asked for, those of furcl first."""
    return tuple(_registered)


def find(name: str) -> Sampler:
    """The sampler of a name.

    Raises
    ------
    SamplerError    unknown name, with those that are known
    """
    if name in _registered:
        return _registered[name]
    near = difflib.get_close_matches(name, _registered, 1, 0.5)
    raise SamplerError(
        f"sampling = {name!r}: allowed are {', '.join(_registered)}"
        + (f"; did you mean {near[0]!r}?" if near else "; furcl.fibre.samplers.register adds one")
    )


def register(
    name: str,
    clh: str | os.PathLike[str],
    *,
    needs_tables: bool,
    scattered_angles: Literal["uniform", "profile"] = "uniform",
) -> Sampler:
    """Make a sampler of one's own usable under a name; one of that name is replaced.

    Parameters
    ----------
    name : str                  for `sampling`, other than those of furcl
    clh : path                  file with the functions of FUNCTIONS; what it includes is sought
                                beside it, then among furcl's kernels
    needs_tables : bool         pass the attenuation tables
    scattered_angles : str      "uniform" or "profile", see `Sampler`

    Raises
    ------
    SamplerError    a name of furcl's own, an unknown kind of angles, or a file that cannot be
                    read or lacks one of the functions
    """
    if name in BUILT_IN or not name:
        raise SamplerError(
            f"sampler {name!r}: the name must not be empty or one of {', '.join(BUILT_IN)}; "
            f"choose another"
        )
    if scattered_angles not in ("uniform", "profile"):
        raise SamplerError(
            f"sampler {name!r}: scattered_angles = {scattered_angles!r}; allowed are 'uniform' "
            f"and 'profile'"
        )
    sampler = Sampler(name, Path(clh).absolute(), needs_tables, scattered_angles)
    text = sampler.source()
    missing = [function for function in FUNCTIONS if function not in text]
    if missing:
        raise SamplerError(
            f"sampler {name!r}: {clh} does not define {' and '.join(missing)}; see "
            f"docs/own_sampler.md"
        )
    _registered[name] = sampler
    return sampler


def unregister(name: str) -> None:
    """Forget a sampler of one's own; SamplerError if there is none of that name."""
    if name in BUILT_IN or name not in _registered:
        raise SamplerError(f"sampler {name!r} was not registered; nothing to remove")
    del _registered[name]
