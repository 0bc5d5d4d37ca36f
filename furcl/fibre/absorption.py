"""Where the absorption of fibres differs: from strand to strand, or from root to tip."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from furcl.errors import GroomError
from furcl.fibre.pigment import COLOUR_RANGE, EUMELANIN, PHEOMELANIN
from furcl.groom.attributes import CLUMP
from furcl.groom.curves import Curves
from furcl.image.colour import srgb_decode
from furcl.table import Table

if TYPE_CHECKING:
    from furcl.fibre.model import FibreModel

log = logging.getLogger(__name__)

Values = NDArray[np.floating]

COLUMNS = {"colour": (1, 3), "sigma": (1, 3), "melanin": (1, 2)}
"""Numbers that a value of each quantity may have."""

LARGEST_SPREAD = 3.0
"""Random factors of strands are within so many standard deviations of their logarithm."""

MOST_SIGMA = 1e4


class Absorption(Table, frozen=True, kw_only=True):
    """Absorption that differs between strands or along them.

    It comes from an attribute of the strands, from a ramp, or from a ramp over an attribute; each
    strand can be lighter or darker at random. Attributes are the arrays of the groom's file, such
    as `colours`, and where it has none of that name `along` (place along the strand, 0 at the root
    to 1 at the tip), `random` (a number of 0 to 1 for each strand) and `length` (of the strand).
    Grown hair and fur and children of guides have `clump`, such a number for each clump.

    Attributes
    ----------
    attribute : str         name of what it follows; with a ramp `along` if left out
    ramp : list of lists    values at the places `at`, linear between them; without it the attribute
                            is the value
    at : list of numbers    values of the attribute, increasing, one for each value of the
                            ramp; even from 0 to 1 if left out
    quantity : str          what values are: a "colour" that a thick groom takes, linear, of
                            1e-6 to 1 (lower ones count as 1e-6); "sigma", the absorption itself
                            per fibre radius, 0 to 10000; "melanin", eumelanin or
                            eumelanin and pheomelanin, 0 to 100
    srgb : bool             colours are encoded by the curve of sRGB
    variation : float       standard deviation of the logarithm of a random factor on the absorption
                            of each strand, cut off at three of them
    seed : int              of random numbers
    """

    attribute: Annotated[str | None, Meta(examples=["colours"])] = None
    ramp: tuple[tuple[float, ...], ...] | None = None
    at: tuple[float, ...] | None = None
    quantity: Literal["colour", "sigma", "melanin"] = "colour"
    srgb: bool = False
    variation: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.0
    seed: Annotated[int, Meta(ge=0, le=(1 << 32) - 1)] = 0

    def __post_init__(self) -> None:
        if not self.has_values and not self.variation:
            raise ValueError(
                "attribute = None: absorption follows nothing; give attribute, ramp or variation"
            )
        if self.srgb and self.quantity != "colour":
            raise ValueError(f"srgb = True: a {self.quantity} has no sRGB curve; leave it out")
        if self.at is not None and self.ramp is None:
            raise ValueError("at = ...: there is no ramp for it; give ramp or leave at out")
        if self.ramp is None:
            return
        if len(self.ramp) < 2:
            raise ValueError(f"ramp = {self.ramp}: a ramp has at least two values")
        columns = {len(value) for value in self.ramp}
        if len(columns) > 1 or columns.pop() not in COLUMNS[self.quantity]:
            raise ValueError(
                f"ramp = {self.ramp}: values of quantity = {self.quantity!r} are "
                f"{_either(COLUMNS[self.quantity])}, all alike"
            )
        if self.at is not None and (
            len(self.at) != len(self.ramp) or not (np.diff(self.at) > 0.0).all()
        ):
            raise ValueError(
                f"at = {self.at}: expected {len(self.ramp)} increasing numbers, one for each value "
                f"of the ramp"
            )
        _check_range(np.array(self.ramp), self.quantity, self.srgb, ValueError, "ramp")

    @property
    def has_values(self) -> bool:
        """Whether it says values, and not only how the fibre's own vary."""
        return self.attribute is not None or self.ramp is not None

    @property
    def name(self) -> str | None:
        """The attribute that it follows."""
        return "along" if self.attribute is None and self.ramp is not None else self.attribute

    def roots(self, curves: Curves, model: FibreModel, fibre: Any, groom: str) -> Values:
        """The square root of the absorption of strands (S, 3), or of points (N, 3), float32.

        Parameters
        ----------
        curves : Curves
        fibre : object          parameters of that model; its own absorption is taken where only the
                                variation is said
        groom : str             name of the groom, for messages; another name has other random
                                numbers

        Raises
        ------
        GroomError      no attribute of that name, or values outside their range or that of the ramp
        FibreError      colours for a model that has no absorption for them
        """
        where = f"groom {groom}: absorption"
        if self.has_values:
            sigma = self._sigma(curves, model, fibre, where, groom)
        else:
            sigma = np.tile(getattr(fibre, str(model.absorbed)), (curves.n_strands, 1))
        if sigma.max() > MOST_SIGMA:
            raise GroomError(
                f"{where}: {sigma.max():g} per fibre radius; at most {MOST_SIGMA:g} is allowed"
            )
        roots = np.sqrt(sigma).astype(np.float32)
        if self.variation:
            normal = _random(self.seed + 1, groom).standard_normal(curves.n_strands, np.float32)
            factor = np.exp(0.5 * self.variation * np.clip(normal, -LARGEST_SPREAD, LARGEST_SPREAD))
            if len(roots) != curves.n_strands:
                factor = np.repeat(factor, np.diff(curves.offsets))
            roots *= factor[:, None]
        return roots

    def _sigma(
        self, curves: Curves, model: FibreModel, fibre: Any, where: str, groom: str
    ) -> Values:
        """Absorption (rows, 3) of the values."""
        name = str(self.name)
        values = _attribute(curves, name, self.seed, where, groom)
        values = values.reshape(len(values), -1).astype(np.float64)
        if self.ramp is not None:
            values = self._by_ramp(values, name, where)
        elif values.shape[1] not in COLUMNS[self.quantity]:
            raise GroomError(
                f"{where}.attribute = {name!r}: it has {values.shape[1]} numbers a value, "
                f"quantity = {self.quantity!r} wants {_either(COLUMNS[self.quantity])}; choose "
                f"another quantity, or give a ramp over an attribute of one number"
            )
        _check_range(values, self.quantity, self.srgb, GroomError, f"{where}: {name}")
        if self.quantity == "melanin":
            pigments = np.array([EUMELANIN, PHEOMELANIN][: values.shape[1]])
            return values @ pigments
        values = np.broadcast_to(values, (len(values), 3))
        if self.quantity == "sigma":
            return values
        colours = srgb_decode(values) if self.srgb else values
        low = int(np.count_nonzero(colours < COLOUR_RANGE[0]))
        if low:
            log.warning("%s: %d numbers of colours are raised to %g", where, low, COLOUR_RANGE[0])
        return model.absorption_of_colour(fibre, np.maximum(colours, COLOUR_RANGE[0]))

    def _by_ramp(self, values: Values, name: str, where: str) -> Values:
        assert self.ramp is not None
        if values.shape[1] != 1:
            raise GroomError(
                f"{where}.attribute = {name!r}: it has {values.shape[1]} numbers a value, a ramp "
                f"goes over one; leave the ramp out, or choose another attribute"
            )
        at = np.linspace(0.0, 1.0, len(self.ramp)) if self.at is None else np.array(self.at)
        low, high = values.min(), values.max()
        if low < at[0] or high > at[-1]:
            raise GroomError(
                f"{where}: values of {name!r} go from {low:g} to {high:g}, the ramp from {at[0]:g} "
                f"to {at[-1]:g}; extend `at`"
            )
        ramp = np.array(self.ramp)
        return np.stack([np.interp(values[:, 0], at, column) for column in ramp.T], axis=1)


def unused_attributes(curves: Curves, absorption: Absorption | None) -> list[str]:
    """Names of the arrays that a groom's file has and its material does not use; what generators
    give every groom is none of them."""
    used = None if absorption is None else absorption.name
    names = (*curves.attributes, *curves.ignored)
    return [name for name in names if name not in (used, CLUMP)]


def _attribute(curves: Curves, name: str, seed: int, where: str, groom: str) -> Values:
    """The values of an attribute of strands or points."""
    if name in curves.attributes:
        return curves.attributes[name]
    if name == "along":
        return _along(curves)
    if name == "random":
        return _random(seed, groom).random(curves.n_strands, np.float32)
    if name == "length":
        return _arc(curves)[curves.offsets[1:] - 1]
    known = ", ".join([*curves.attributes, "along", "random", "length"])
    raise GroomError(
        f"{where}.attribute = {name!r}: the groom has none of that name; it has {known}"
    )


def _random(seed: int, groom: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(groom.encode())])


def _arc(curves: Curves) -> Values:
    """Length of the strand up to each point (N,) [unit]."""
    steps = np.linalg.norm(np.diff(curves.points, axis=0), axis=1).astype(np.float64)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    return arc - np.repeat(arc[curves.offsets[:-1]], np.diff(curves.offsets))


def _along(curves: Curves) -> Values:
    """Place of each point along its strand (N,), 0 at the root to 1 at the tip."""
    arc = _arc(curves)
    length = np.repeat(arc[curves.offsets[1:] - 1], np.diff(curves.offsets))
    return np.minimum(arc / length, 1.0)


def _check_range(
    values: Values, quantity: str, srgb: bool, error: type[Exception], where: str
) -> None:
    """Refuse values outside the range of their quantity."""
    most = {"colour": 1.0, "sigma": MOST_SIGMA, "melanin": 100.0}[quantity]
    if not (values.min() >= 0.0 and values.max() <= most):
        hint = "; divide them, or say srgb = true" if quantity == "colour" and not srgb else ""
        raise error(
            f"{where} = {values.min():g} to {values.max():g}: a {quantity} is from 0 to "
            f"{most:g}{hint}"
        )


def _either(columns: Sequence[int]) -> str:
    return " or ".join(f"{n} number{'s' * (n > 1)}" for n in columns)
