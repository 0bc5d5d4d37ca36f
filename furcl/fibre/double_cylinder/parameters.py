"""The parameters of one hair or fur fibre, and named sets of them."""

import dataclasses
import difflib
import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

from furcl.errors import FibreError
from furcl.fibre.pigment import BETA_RANGE_DEG, sigma_ca_from_melanin
from furcl.fibre.ranges import Triple, check_parameters

RANGES: dict[str, tuple[float, float]] = {
    "eta": (1.0001, 3.0),
    "kappa": (0.0, 1.0),
    "alpha_deg": (-20.0, 20.0),
    "beta_m_deg": BETA_RANGE_DEG,
    "beta_n_deg": BETA_RANGE_DEG,
    "sigma_ca": (0.0, 1e4),
    "sigma_ms": (0.0, 1e4),
    "sigma_ma": (0.0, 1e4),
    "g": (-0.99, 0.99),
    "layers": (0.0, 10.0),
}
_COLOURS = ("sigma_ca", "sigma_ma")

Scattering = Literal["model", "simulated"]


@dataclass(frozen=True)
class Fibre:
    """A fibre of cuticle, cortex and medulla (double cylinder).

    Sigmas are per fibre radius, so a fibre looks the same at any scale. The defaults are a clear
    fibre without a medulla.

    Parameters
    ----------
    eta : float         index of refraction, inside over outside, 1.0001..3
    kappa : float       medulla radius over fibre radius; 0: no medulla, 0..1
    alpha_deg : float   tilt of the cuticle scales; published values carry either sign, so the sign
                        is ignored: R always moves towards the root, -20..20 [deg]
    beta_m_deg : float  longitudinal roughness, standard deviation of R, 0.0573..143.2 [deg]
    beta_n_deg : float  azimuthal roughness, standard deviation of R, 0.0573..143.2 [deg]
    sigma_ca : (r,g,b)  absorption of the cortex; one number stands for three equal ones, 0..1e4
                        [1 / fibre radius]
    sigma_ms : float    scattering of the medulla, 0..1e4 [1 / fibre radius]
    sigma_ma : (r,g,b)  absorption of the medulla; one number stands for three equal ones, 0..1e4
                        [1 / fibre radius]
    g : float           mean cosine of the medulla's Henyey-Greenstein phase function, -0.99..0.99
    layers : float      layers of the cuticle; 1/2 is a plain interface, 0 reflects nothing, 0..10
    scattering : str    how light leaves that the medulla has scattered: "model" as published,
                        without refraction and reflection at the cuticle; "simulated" as light in a
                        smooth fibre does, with all orders of reflection, so that a fibre that
                        absorbs nothing returns everything
    provenance : str    where the numbers come from; takes no part in comparisons

    Raises
    ------
    FibreError          names the parameter, its value and the allowed range
    """

    model: ClassVar[str] = "double-cylinder"

    eta: float = 1.55
    kappa: float = 0.0
    alpha_deg: float = 3.0
    beta_m_deg: float = 6.0
    beta_n_deg: float = 8.0
    sigma_ca: Triple = (0.0, 0.0, 0.0)
    sigma_ms: float = 0.0
    sigma_ma: Triple = (0.0, 0.0, 0.0)
    g: float = 0.0
    layers: float = 0.5
    scattering: Scattering = "model"
    provenance: str = dataclasses.field(default="given by the user", compare=False, repr=False)

    def __post_init__(self) -> None:
        check_parameters(self, RANGES, _COLOURS, _UNITS)
        if self.scattering not in get_args(Scattering):
            raise FibreError(
                f"fibre.scattering = {self.scattering!r} - allowed are 'model' and 'simulated'"
            )

    @classmethod
    def preset(cls, name: str, **changes: Any) -> "Fibre":
        """The fibre called `name`, with `changes` to its parameters.

        Fitted to the lobe shares printed by Shibaike and Iwasaki (their tables 2 to 4; alpha, the
        betas and g do not enter the shares and are plausible values): ``human-white``,
        ``human-black``, ``raccoon``.
        Second-hand, a scene's comment that quotes the measured table of Yan et al. 2017:
        ``red-fox``.
        Unlabelled, defaults of re-implementations that name no species: ``unlabelled-a``,
        ``unlabelled-b``.
        Human hair by pigment, the geometry of human-white with concentrations chosen here:
        ``black``, ``brown``, ``blond``, ``red``; ``white`` is human-white.

        Raises
        ------
        FibreError   unknown name (the nearest one is given), unknown parameter, or value outside
                     its range
        """
        if name not in _PRESETS:
            near = difflib.get_close_matches(name.lower().replace("_", "-"), _PRESETS, 1, 0.0)
            raise FibreError(
                f"fibre.preset = {name!r} is not known - did you mean {near[0]!r}? - "
                f"allowed are {', '.join(_PRESETS)}"
            )
        return _PRESETS[name].replace(**changes)

    @staticmethod
    def preset_names() -> tuple[str, ...]:
        """Names that `preset` takes."""
        return tuple(_PRESETS)

    def replace(self, **changes: Any) -> "Fibre":
        """A copy with `changes`; the provenance tells which parameters were changed.

        Raises
        ------
        FibreError   unknown parameter or value outside its range
        """
        known = [*RANGES, "scattering"]
        for name in changes:
            if name not in known and name != "provenance":
                near = difflib.get_close_matches(name, known, 1, 0.0)[0]
                raise FibreError(
                    f"fibre.{name} is not a parameter - did you mean {near}? - "
                    f"allowed are {', '.join(known)}"
                )
        if changes and "provenance" not in changes:
            changes["provenance"] = f"{self.provenance}; changed: {', '.join(sorted(changes))}"
        return dataclasses.replace(self, **changes)

    @property
    def alpha(self) -> float:
        """Tilt of the cuticle scales [rad], signed as given."""
        return math.radians(self.alpha_deg)

    @property
    def tilt(self) -> float:
        """The tilt that the lobes use, -|alpha| [rad]: negative moves R towards the root."""
        return -abs(self.alpha)

    @property
    def beta_m(self) -> float:
        """Longitudinal roughness [rad]."""
        return math.radians(self.beta_m_deg)

    @property
    def beta_n(self) -> float:
        """Azimuthal roughness [rad]."""
        return math.radians(self.beta_n_deg)

    @property
    def is_simulated(self) -> bool:
        """Whether scattered light leaves as it was simulated to, and all orders have a lobe."""
        return self.scattering == "simulated"

    @property
    def has_medulla(self) -> bool:
        """Whether scattered lobes can exist at all: a medulla that scatters."""
        return self.kappa > 0.0 and self.sigma_ms > 0.0


_UNITS = {
    "eta": " (inside over outside)",
    "kappa": " (medulla radius over fibre radius)",
    "alpha_deg": " degrees",
    "beta_m_deg": " degrees",
    "beta_n_deg": " degrees",
    "sigma_ca": " per fibre radius",
    "sigma_ms": " per fibre radius",
    "sigma_ma": " per fibre radius",
    "g": " (mean cosine)",
    "layers": " layers",
}

_FITTED = (
    "fitted: to the lobe shares that Shibaike and Iwasaki print (tables 2-4); "
    "alpha, beta and g are plausible values"
)
_HUMAN_WHITE = Fibre(
    kappa=0.41,
    eta=1.56,
    alpha_deg=3,
    beta_m_deg=6,
    beta_n_deg=8,
    sigma_ca=(0.41, 0.41, 0.41),
    sigma_ms=2.14,
    g=0.3,
    layers=0.40,
    provenance=_FITTED + "; sigma_ca 0.41 is printed there",
)
_RACCOON = Fibre(
    kappa=0.64,
    eta=1.452,
    alpha_deg=3,
    beta_m_deg=8,
    beta_n_deg=10,
    sigma_ca=(0.05, 0.05, 0.05),
    sigma_ms=1.564,
    sigma_ma=(0.2, 0.2, 0.2),
    g=0.4,
    layers=0.736,
    provenance=_FITTED + "; sigma_ma with the absorption of the simulated profiles",
)
_RED_FOX = Fibre(
    kappa=0.86,
    eta=1.49,
    alpha_deg=2.64,
    beta_m_deg=9.45,
    beta_n_deg=17.63,
    sigma_ca=(0.39, 0.39, 0.39),
    sigma_ms=3.15,
    sigma_ma=(0.21, 0.21, 0.21),
    g=0.79,
    layers=0.68,
    provenance=(
        "second-hand: a comment in a student renderer's scene that quotes the measured table of "
        "Yan et al. 2017"
    ),
)
_UNLABELLED_A = Fibre(
    kappa=0.88,
    eta=1.55,
    alpha_deg=5.48,
    beta_m_deg=11.64,
    beta_n_deg=7.49,
    sigma_ca=(0.64, 0.64, 0.64),
    sigma_ms=1.69,
    sigma_ma=(0.17, 0.17, 0.17),
    g=0.44,
    layers=0.47,
    provenance=(
        "unlabelled: defaults of the YanFur plugin; they look like a fitted row, the species is "
        "not stated; medium confidence"
    ),
)
_UNLABELLED_B = Fibre(
    kappa=0.65,
    eta=1.19,
    alpha_deg=1.81,
    beta_m_deg=7.44,
    beta_n_deg=6.88,
    sigma_ca=(0.12, 0.25, 0.37),
    sigma_ms=2.30,
    sigma_ma=(0.14, 0.14, 0.14),
    g=0.08,
    layers=2,
    provenance=(
        "unlabelled: a set commented out in a student renderer; eta and layers look changed by "
        "hand; low confidence"
    ),
)


def _pigmented(eumelanin: float, pheomelanin: float) -> Fibre:
    return _HUMAN_WHITE.replace(
        sigma_ca=sigma_ca_from_melanin(eumelanin, pheomelanin),
        provenance=(
            f"chosen here: human-white with eumelanin {eumelanin:g} and pheomelanin "
            f"{pheomelanin:g} (coefficients of Chiang et al. 2016)"
        ),
    )


_PRESETS: dict[str, Fibre] = {
    "human-white": _HUMAN_WHITE,
    "human-black": _HUMAN_WHITE.replace(
        sigma_ca=4.10, provenance=_FITTED + "; human-white with the printed sigma_ca 4.10"
    ),
    "raccoon": _RACCOON,
    "red-fox": _RED_FOX,
    "unlabelled-a": _UNLABELLED_A,
    "unlabelled-b": _UNLABELLED_B,
    "black": _pigmented(8.0, 0.0),
    "brown": _pigmented(1.3, 0.2),
    "blond": _pigmented(0.3, 0.1),
    "red": _pigmented(0.25, 1.2),
    "white": _HUMAN_WHITE,
}
