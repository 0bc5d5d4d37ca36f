"""What a scene needs of the kernels: the one source of `-D FURCL_*`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from furcl.fibre import samplers

ENVIRONMENTS = ("constant", "sky", "image")
FILTERS = ("box", "tent", "gaussian")
LOBES = ("R", "TT", "TRT", "TTs", "TRTs")
SCATTERED_LOBES = ("TTs", "TRTs")
RESIDUAL_LOBE = "residual"
ALL_LOBES = (*LOBES, RESIDUAL_LOBE)


@dataclass(frozen=True)
class Features:
    """Everything that changes the text of a kernel. Frozen; the key of the kernel cache.

    Attributes
    ----------
    sampling : str              a name of furcl.fibre.samplers
    channels : int              3 for RGB, 1 where fibre, body and light are grey
    medulla : bool              rays may cross a medulla that absorbs or scatters
    scattered : bool            lobes TT^s and TRT^s (kappa > 0 and sigma_ms > 0)
    profile_channels : int      channels of medulla absorption in the profiles: 0, 1 or 3
    layered : bool              cuticle other than a plain interface (layers != 1/2)
    tilt : bool                 alpha != 0
    residual : bool             lobe TRRT+ that closes the furnace
    dropped_lobes : tuple       names of lobes left out because they carry next to nothing
    environment : str           one of ENVIRONMENTS
    light_sampling : bool       the environment is sampled too (MIS)
    point_radii : bool          the radius differs between points of the groom
    body : bool                 an ellipsoid inside the groom
    lens : bool                 camera with a finite aperture
    filter : str                one of FILTERS
    roulette : bool             Russian roulette within the depth limit
    variance : bool             film keeps second moments
    statistics : bool           counters of lobes and path lengths
    debug : bool                index checks in every buffer access that has one
    """

    sampling: str = "full-cdf"
    channels: int = 3
    medulla: bool = True
    scattered: bool = True
    profile_channels: int = 3
    layered: bool = True
    tilt: bool = True
    residual: bool = False
    dropped_lobes: tuple[str, ...] = ()
    environment: str = "constant"
    light_sampling: bool = False
    point_radii: bool = True
    body: bool = False
    lens: bool = False
    filter: str = "gaussian"
    roulette: bool = True
    variance: bool = True
    statistics: bool = True
    debug: bool = False

    @property
    def n_lobes(self) -> int:
        """Planes of the lobe tables: the five lobes in fixed order, then the residual."""
        return 6 if self.residual else 5

    @property
    def lobes(self) -> tuple[str, ...]:
        """Names of the lobes that are compiled in."""
        absent = set(self.dropped_lobes)
        if not self.scattered:
            absent |= set(SCATTERED_LOBES)
        return tuple(name for name in ALL_LOBES[: self.n_lobes] if name not in absent)

    @property
    def sampler(self) -> samplers.Sampler:
        """The sampler that `sampling` names; its file is the virtual include "sampler.clh"."""
        return samplers.find(self.sampling)

    def defines(self) -> dict[str, int]:
        """Names and values of the preprocessor defines, all prefixed FURCL_."""
        values: dict[str, int] = {}
        for name, value in asdict(self).items():
            if name in ("sampling", "dropped_lobes"):
                continue
            if name == "environment":
                value = ENVIRONMENTS.index(value)
            elif name == "filter":
                value = FILTERS.index(value)
            values[f"FURCL_{name.upper()}"] = int(value)
        values["FURCL_PROFILE_ANGLES"] = int(self.sampler.scattered_angles == "profile")
        values["FURCL_LOBES"] = self.n_lobes
        values["FURCL_LOBE_MASK"] = sum(
            1 << index for index, name in enumerate(ALL_LOBES) if name in self.lobes
        )
        return values

    def with_(self, **changes: Any) -> Features:
        """A copy with some fields changed."""
        return replace(self, **changes)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON and image headers."""
        return asdict(self)
