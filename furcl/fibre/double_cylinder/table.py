"""The table of a double-cylinder fibre in a scene."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from furcl.fibre.double_cylinder.parameters import RANGES, Fibre, Scattering
from furcl.fibre.melanin import Melanin
from furcl.fibre.model import ModelTable
from furcl.fibre.pigment import COLOUR_RANGE, sigma_ca_from_colour, sigma_ca_from_melanin
from furcl.table import Rgb


class FibreTable(ModelTable, frozen=True, kw_only=True, tag_field="model", tag="double-cylinder"):
    """A preset, parameters that replace its own, and the colour in at most one of three ways.

    Without a preset exactly one of sigma_ca, colour and melanin is required, and the other
    parameters default to those of `furcl.Fibre`.

    Attributes
    ----------
    preset : str            parameters by name, see `furcl.Fibre.preset`
    colour : (r,g,b)        wanted colour of a thick groom, from which sigma_ca follows
    melanin : table         pigments, from which sigma_ca follows
    absorption : table      sigma_ca where it differs between strands or along them
    mode : str              where across the fibre light meets it: "far" anywhere, so that it shows
                            its mean, "near" where the ray does, for fibres that are seen wide,
                            "multiscale" near it, within the pixel of a camera ray, and
                            anywhere after that
    """

    described_by: ClassVar = Fibre
    allowed: ClassVar = {**RANGES, "preset": Fibre.preset_names(), "colour": COLOUR_RANGE}

    preset: Annotated[str | None, Meta(examples=["human-black"])] = None
    eta: float | None = None
    kappa: float | None = None
    alpha_deg: float | None = None
    beta_m_deg: float | None = None
    beta_n_deg: float | None = None
    sigma_ca: Rgb | None = None
    sigma_ms: float | None = None
    sigma_ma: Rgb | None = None
    g: float | None = None
    layers: float | None = None
    scattering: Scattering | None = None
    colour: tuple[float, float, float] | None = None
    melanin: Melanin | None = None

    def __post_init__(self) -> None:
        if self.scattering == "simulated" and self.absorption is not None:
            raise ValueError(
                "scattering = 'simulated': its tables are for one absorption and there is "
                "absorption; leave that out, or scattering"
            )
        ways = [k for k in ("sigma_ca", "colour", "melanin") if getattr(self, k) is not None]
        ways += ["absorption"] if self.absorption and self.absorption.has_values else []
        if len(ways) > 1:
            raise ValueError(f"the colour is given by {' and '.join(ways)}; keep one of them")
        if not ways and self.preset is None:
            raise ValueError(
                "there is neither a preset nor a colour; give preset, sigma_ca, colour, "
                "melanin or absorption"
            )

    def build(self) -> Fibre:
        """The fibre that the table describes.

        Raises
        ------
        FibreError      unknown preset, or a value outside its range
        """
        changes = self.given()
        if self.preset is not None:
            fibre = Fibre.preset(self.preset, **changes)
        else:
            fibre = Fibre(**changes)
        if self.melanin is not None:
            sigma_ca = sigma_ca_from_melanin(self.melanin.eumelanin, self.melanin.pheomelanin)
            return fibre.replace(sigma_ca=sigma_ca)
        if self.colour is not None:
            return fibre.replace(sigma_ca=sigma_ca_from_colour(self.colour, fibre.beta_n_deg))
        return fibre
