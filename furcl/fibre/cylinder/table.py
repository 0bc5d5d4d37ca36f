"""What the tables [fibre] of cylinders without a medulla share."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Annotated, Any

from msgspec import Meta

from furcl.fibre.cylinder.presets import absorption as absorption_of
from furcl.fibre.melanin import Melanin
from furcl.fibre.model import ModelTable
from furcl.fibre.pigment import sigma_ca_from_melanin
from furcl.table import Rgb, Triple

_COLOURS = ("sigma_a", "colour", "melanin")


class CylinderTable(ModelTable, frozen=True, kw_only=True, tag_field="model"):
    """A preset, parameters that replace its own, and the colour in at most one of three ways.

    Attributes
    ----------
    preset : str            parameters by name
    colour : (r,g,b)        wanted colour of a thick groom, from which sigma_a follows
    melanin : table         pigments, from which sigma_a follows
    absorption : table      sigma_a where it differs between strands or along them
    mode : str              as of the double cylinder: "far", "near", "multiscale"
    """

    preset: Annotated[str | None, Meta(examples=["brown"])] = None
    eta: float | None = None
    alpha_deg: float | None = None
    sigma_a: Rgb | None = None
    colour: tuple[float, float, float] | None = None
    melanin: Melanin | None = None

    def __post_init__(self) -> None:
        ways = [name for name in _COLOURS if getattr(self, name) is not None]
        ways += ["absorption"] if self.absorption and self.absorption.has_values else []
        if len(ways) > 1:
            raise ValueError(f"the colour is given by {' and '.join(ways)}; keep one of them")
        if not ways and self.preset is None:
            raise ValueError(
                "there is neither a preset nor a colour; give preset, sigma_a, colour, melanin or "
                "absorption"
            )

    def build(self) -> Any:
        """The fibre that the table describes, of the class `described_by`.

        Raises
        ------
        FibreError      unknown preset, or a value outside its range
        """
        given = self.given()
        if self.melanin is not None:
            pigments = self.melanin.eumelanin, self.melanin.pheomelanin
            given["sigma_a"] = sigma_ca_from_melanin(*pigments)
        if self.preset is not None:
            given = {"sigma_a": absorption_of(self.preset), **given}
        assert self.described_by is not None
        fibre = self.described_by(**given)
        if self.colour is None:
            return fibre
        return replace(fibre, sigma_a=self.sigma_of(self.colour, fibre))

    @abstractmethod
    def sigma_of(self, colour: Triple, fibre: Any) -> Triple:
        """Absorption of the fibre for which a thick groom takes about a colour, linear.

        Raises
        ------
        FibreError      a channel outside its range
        """
