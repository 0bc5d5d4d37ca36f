"""What a fibre model is to everything outside it, and the models by name.

A model is one device header (kernels/include/fibre/material.clh says what it defines), this
description of it, a float64 reference written apart, and a page of docs. Materials, the renderer,
the probe and the benchmarks know models through it alone.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from furcl.device.layout import Fields, Mode
from furcl.errors import FibreError
from furcl.fibre.absorption import Absorption
from furcl.paths import kernel_folder
from furcl.registry import Registry
from furcl.table import Table

if TYPE_CHECKING:
    from furcl.device.choice import Device


@dataclass(frozen=True)
class Lobe:
    """One lobe of a model.

    Attributes
    ----------
    name : str          as in statistics, e.g. "TT"
    narrow : bool       may be far narrower than a hemisphere: it wants to be sampled by its own
                        density; other lobes are smooth
    h_given_phi : bool  its header draws h for a direction (lobe_azimuthal_estimate of
                        kernels/include/fibre/material.clh); if not, light samples use an h of the
                        sampler's
    """

    name: str
    narrow: bool = True
    h_given_phi: bool = False


class FibreFeatures(ABC):
    """What one fibre needs of its model's header: the part <fibre> of furcl.device.features.

    Subclasses are frozen dataclasses; `dropped_lobes` names lobes left out because they carry next
    to nothing.
    """

    dropped_lobes: tuple[str, ...]

    @property
    @abstractmethod
    def model(self) -> FibreModel:
        """The model."""

    @property
    @abstractmethod
    def lobes(self) -> tuple[str, ...]:
        """Names of the lobes that are compiled in, in the model's order."""

    @property
    @abstractmethod
    def n_lobes(self) -> int:
        """Lobes that have a place in tables and counters, compiled in or not: the first of the
        model's."""

    @property
    @abstractmethod
    def data_words(self) -> int:
        """Words of the model's own data (`FibreModel.data`)."""

    @abstractmethod
    def switches(self) -> Mapping[str, int]:
        """FURCL_* defines of what can be left out of the header."""

    @abstractmethod
    def without(self, lobes: Collection[str]) -> FibreFeatures:
        """The features of the same fibre without some lobes and what they alone need."""

    @abstractmethod
    def everything_on(self) -> FibreFeatures:
        """The same expected values from a header with all code that some fibre could need."""

    @abstractmethod
    def optional(self) -> dict[str, tuple[bool, str]]:
        """Name of each thing that can be left out -> whether it is there, and why it might not."""

    @abstractmethod
    def as_dict(self) -> Mapping[str, Any]:
        """Plain values for JSON and image headers."""

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.model.name

    @property
    def header(self) -> Path:
        """The model's header."""
        return self.model.header

    def defines(self) -> dict[str, int | str]:
        """Everything that the header and fibre/sampler.clh use."""
        names = [lobe.name for lobe in self.model.lobes]
        return {
            **self.model.constants(),
            "FURCL_ABSORBED": self.model.absorbed or "nothing",
            **{f"FURCL_LOBE_{name.upper()}": f"{i}u" for i, name in enumerate(names)},
            **self.switches(),
            "FURCL_LOBES": self.n_lobes,
            "FURCL_LOBE_MASK": sum(1 << names.index(lobe) for lobe in self.lobes),
            "FURCL_H_GIVEN_PHI": sum(
                1 << names.index(lobe.name)
                for lobe in self.model.lobes
                if lobe.h_given_phi and lobe.name in self.lobes
            ),
            "FURCL_FIBRE_DATA_WORDS": self.data_words,
        }

    def structs(self) -> dict[str, Fields]:
        """FibreParams."""
        return {"FibreParams": self.model.struct}


class ModelTable(Table, frozen=True, kw_only=True):
    """Base of the tables [fibre] of scenes, tagged by `model`.

    Attributes
    ----------
    absorption : table      where strands, or points along them, absorb differently
    mode : str              where across the fibre light meets it: "far" anywhere, so that it shows
                            its mean, "near" where the ray does, for fibres that are seen wide,
                            "multiscale" near it, within the pixel of a camera ray, and
                            anywhere after that
    """

    absorption: Absorption | None = None
    mode: Mode = "far"

    def given(self) -> dict[str, Any]:
        """Values of the keys that are parameters of the fibre, of those that are not left out."""
        assert self.described_by is not None
        names = [field.name for field in dataclasses.fields(self.described_by)]
        values = {name: getattr(self, name, None) for name in names}
        return {name: value for name, value in values.items() if value is not None}

    def build(self) -> Any:
        """The fibre that the table describes, parameters of the model's own class.

        Raises
        ------
        FibreError      a value outside its range
        """
        raise NotImplementedError


class FibreModel(ABC):
    """A scattering function of fibres.

    Parameters of a fibre are an object of a class of the model's own, here `fibre`, whose attribute
    `model` is the model's name.

    Attributes
    ----------
    name : str          as in scenes: fibre.model = "double-cylinder"
    lobes : tuple       all lobes, those that are always there first
    header : Path       of kernels/include, or absolute
    struct : Fields     of FibreParams
    reference : str     module of the float64 reference: evaluate, pdf, sample, attenuation
    absorbed : str or None      the parameter, a float4 of the struct and three numbers of a fibre,
                                that strands or points can have values of; attenuations are convex
                                in each channel of it. None: there is none
    has_offset : bool   whether the value depends on the offset h, and so can be near field
    """

    name: ClassVar[str]
    lobes: ClassVar[tuple[Lobe, ...]]
    header: ClassVar[Path]
    struct: ClassVar[Fields]
    reference: ClassVar[str]
    absorbed: ClassVar[str | None] = None
    has_offset: ClassVar[bool] = True

    @property
    @abstractmethod
    def table(self) -> type[ModelTable]:
        """Type of the table [fibre] in a scene, tagged by the model's name."""

    @abstractmethod
    def features(self, fibre: Any, *, residual: bool = False) -> FibreFeatures:
        """What a fibre needs of the header. `residual`: with the lobe that holds all orders which
        the others leave out, if the model has one."""

    @abstractmethod
    def is_grey(self, fibre: Any) -> bool:
        """Whether one channel tells all."""

    @abstractmethod
    def params(self, fibre: Any) -> np.ndarray:
        """The struct FibreParams of a fibre."""

    def with_absorption(self, fibre: Any, sigma: tuple[float, float, float]) -> Any:
        """The fibre with another value of `absorbed`."""
        return dataclasses.replace(fibre, **{str(self.absorbed): sigma})

    def why_one_absorption(self, fibre: Any) -> str | None:
        """Why the fibre takes no absorption that differs from hit to hit; None where it does."""
        return None

    def absorption_of_colour(self, fibre: Any, colour: np.ndarray) -> np.ndarray:
        """Absorption (n, 3) for which thick grooms of the fibre take about the colours (n, 3),
        linear, of 1e-6 to 1.

        Raises
        ------
        FibreError      the model has no such rule
        """
        raise FibreError(
            f"fibre.model = {self.name!r} has no absorption for a colour; give absorptions"
        )

    def warning(self, fibre: Any) -> str | None:
        """What is wrong with light of a fibre, such as that there is ever more of it; None where
        nothing is."""
        return None

    def constants(self) -> Mapping[str, int | str]:
        """FURCL_* constants of the header."""
        return {}

    def prepare(self, device: Device, fibre: Any) -> Any:
        """What is computed or loaded once for a fibre, such as simulated profiles; None where
        nothing is."""
        return None

    def draft(self, device: Device, fibre: Any) -> tuple[Any, bool]:
        """What stands for what `prepare` makes while a fibre is being changed, made in a moment,
        and whether it is noisier. By default that itself."""
        return self.prepare(device, fibre), False

    def data(self, prepared: Any, features: Any) -> np.ndarray:
        """The model's own data (features.data_words,) float32, made of what `prepare` returned."""
        return np.zeros(features.data_words, np.float32)


# What a header defines (kernels/include/fibre/material.clh), the last one for lobes that say so.
FUNCTIONS = (
    "incidence_at",
    "bcsdf_at_offset",
    "bcsdf_of_lobe",
    "lobe_attenuation",
    "attenuation_edge",
    "lobe_terms",
    "lobe_value_over_pdf",
    "lobe_sample_direction",
    "lobe_inclination_densities",
    "lobe_azimuth_density",
)
H_GIVEN_PHI_FUNCTION = "lobe_azimuthal_estimate"

# furcl's own by their modules, which import this one.
_models: Registry[FibreModel | str] = Registry(
    "fibre model",
    FibreError,
    {
        "double-cylinder": "furcl.fibre.double_cylinder.model",
        "chiang": "furcl.fibre.chiang.model",
        "deon": "furcl.fibre.deon.model",
        "marschner": "furcl.fibre.marschner.model",
        "sadeghi": "furcl.fibre.sadeghi.model",
        "yan2015": "furcl.fibre.yan2015.model",
    },
)


def names() -> tuple[str, ...]:
    """All models that a scene can name, those of furcl first."""
    return _models.names()


def find(name: str) -> FibreModel:
    """The model of a name.

    Raises
    ------
    FibreError      unknown name, with those that are known
    """
    found = _models.find(name, f"fibre.model = {name!r}: allowed are", "furcl.models.register")
    return import_module(found).MODEL if isinstance(found, str) else found


def model_of(fibre: Any) -> FibreModel:
    """The model of a fibre, which its attribute `model` names.

    Raises
    ------
    FibreError      if there is no such model
    """
    return find(fibre.model)


def check_mode(model: FibreModel, mode: str) -> None:
    """Refuse a mode for which a model would have to know its offset h.

    Raises
    ------
    FibreError
    """
    if mode != "far" and not model.has_offset:
        raise FibreError(
            f"fibre.mode = {mode!r}: model {model.name!r} is its own mean over the fibre's width "
            f"and has no near field; allowed is 'far'"
        )


def tables() -> dict[str, type[ModelTable]]:
    """Name of every model -> type of its table in a scene."""
    return {name: find(name).table for name in names()}


def register(model: FibreModel) -> FibreModel:
    """Make a model of one's own usable under its name; one of that name is replaced.

    Raises
    ------
    FibreError      an empty name, one of furcl's own, or a header that cannot be read or lacks one
                    of the functions
    """
    _models.check_name(model.name)
    functions = FUNCTIONS
    if any(lobe.h_given_phi for lobe in model.lobes):
        functions += (H_GIVEN_PHI_FUNCTION,)
    header = kernel_folder() / "include" / model.header
    _models.check_header(model.name, header, functions, "kernels/include/fibre/material.clh")
    _models.add(model.name, model)
    return model


def unregister(name: str) -> None:
    """Forget a model of one's own; FibreError if there is none of that name."""
    _models.remove(name)
