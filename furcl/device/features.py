"""What a scene needs of the kernels: the one source of `-D FURCL_*`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Protocol

from furcl.device.layout import ABSORPTIONS, FILTERS, LAYERS, MODES, SEQUENCES, Fields


class Part(Protocol):
    """What one choice of a scene, such as its fibre model or its light, adds to kernels.

    Parts are frozen, hashable and can be pickled: all that they stand for is in their fields.
    """

    @property
    def name(self) -> str:
        """As scenes say it."""
        ...

    @property
    def header(self) -> Path:
        """The file that its virtual include stands for."""
        ...

    def defines(self) -> Mapping[str, int | str]:
        """Names and values that its header tests or uses: features and constants."""
        ...

    def structs(self) -> Mapping[str, Fields]:
        """Structs that its header uses: names and fields."""
        ...

    def as_dict(self) -> Mapping[str, Any]:
        """Plain values for JSON and image headers."""
        ...


@dataclass(frozen=True)
class Features:
    """Everything that changes the text of a kernel. Frozen; the key of the kernel cache.

    The parts are the virtual includes <fibre>, <sampler>, <light>, <lamps>, <surface>, <meshes>,
    <learning> and <layers>; None where a kernel has nothing to do with them, or the scene has none.

    Attributes
    ----------
    fibre : Part or None        a fibre model and what it needs, see furcl.fibre.model
    sampler : Part or None      how lobe and offset h are chosen, see furcl.fibre.samplers
    light : Part or None        the environment, see furcl.light.model
    lamps : Part or None        see furcl.light.lamps
    surface : Part or None      a surface beside the strands, see furcl.surface
    meshes : Part or None       meshes of triangles, see furcl.surface.mesh
    learning : Part or None     what is learned while rendering, see furcl.rendering.learning
    layers : Part or None       layers of the film, see furcl.rendering.layers
    fibres : int                fibre materials of the scene, each with kernels of its own
    channels : int              3 for RGB, 1 where fibres, surface and light are grey
    absorption : str            one of layout.ABSORPTIONS, of the fibre of a kernel
    motion : int                pieces of time, from step to step, that the groom moves in; 0: it
                                keeps still. One that moves has point_radii
    camera_motion : int         the same of the camera
    mode : str                  one of layout.MODES, of the fibre of a kernel
    light_sampling : bool       the light is sampled too (MIS)
    point_radii : bool          the radius differs between points of the groom
    lens : bool                 camera with a finite aperture
    orthographic : bool         camera whose rays are parallel
    crop : bool                 the film holds a window of the picture
    transparent : bool          camera rays that meet nothing bring no light
    filter : str                one of layout.FILTERS
    sequence : str              of random numbers, one of layout.SEQUENCES
    roulette : bool             Russian roulette within the depth limit
    shadow_roulette : bool      Russian roulette of light samples
    variance : bool             film keeps second moments
    planned : bool              a plan says how many samples each pixel takes
    held : bool                 samples of a pixel can share numbers, see furcl.rendering.held
    statistics : bool           counters of lobes and path lengths
    debug : bool                index checks in every buffer access that has one
    """

    fibre: Part | None = None
    sampler: Part | None = None
    light: Part | None = None
    lamps: Part | None = None
    surface: Part | None = None
    meshes: Part | None = None
    learning: Part | None = None
    layers: Part | None = None
    fibres: int = 1
    channels: int = 3
    absorption: str = "constant"
    motion: int = 0
    camera_motion: int = 0
    mode: str = "far"
    light_sampling: bool = False
    point_radii: bool = True
    lens: bool = False
    orthographic: bool = False
    crop: bool = False
    transparent: bool = False
    filter: str = "gaussian"
    sequence: str = "independent"
    roulette: bool = True
    shadow_roulette: bool = False
    variance: bool = True
    planned: bool = False
    held: bool = False
    statistics: bool = True
    debug: bool = False

    @property
    def parts(self) -> dict[str, Part]:
        """The parts that there are, by the name of their virtual include."""
        found = {name: getattr(self, name) for name in PARTS}
        return {name: part for name, part in found.items() if part is not None}

    @property
    def has_surfaces(self) -> bool:
        """Whether there is more to hit than fibres and lamps."""
        return self.surface is not None or self.meshes is not None

    @property
    def hit_queues(self) -> int:
        """Queues of hits: one for each fibre material, the last for surfaces if there are some."""
        return self.fibres + self.has_surfaces

    @property
    def light_at_infinity(self) -> bool:
        """Whether rays that leave the scene find the environment, and samples of it have no
        distance."""
        return bool(getattr(self.light, "at_infinity", True))

    @property
    def area_lamps(self) -> bool:
        """Whether rays can meet lamps."""
        return bool(getattr(self.lamps, "area", False))

    @property
    def shadow_distances(self) -> bool:
        """Whether light samples have distances."""
        return not self.light_at_infinity or bool(getattr(self.lamps, "placed", False))

    @property
    def marginals(self) -> bool:
        """Whether samples of a fibre and of the light are weighed by densities of directions,
        whatever the offset h: where h is known, those at it are."""
        return self.light_sampling and self.mode != "near"

    def defines(self) -> dict[str, int | str]:
        """Names and values of the preprocessor defines."""
        values: dict[str, int | str] = {
            f"FURCL_{field.name.upper()}": int(getattr(self, field.name))
            for field in fields(self)
            if field.name not in (*PARTS, "filter", "sequence", "absorption", "mode")
        }
        values["FURCL_FILTER"] = FILTERS.index(self.filter)  # pyright: ignore[reportArgumentType]
        values["FURCL_ABSORPTION"] = ABSORPTIONS.index(self.absorption)  # pyright: ignore[reportArgumentType]
        values["FURCL_MODE"] = MODES.index(self.mode)  # pyright: ignore[reportArgumentType]
        values["FURCL_MARGINALS"] = int(self.marginals)
        values["FURCL_SOBOL"] = int(self.sequence == SEQUENCES[1])
        values["FURCL_FIBRES"] = f"{self.fibres}u"
        values["FURCL_SURFACE"] = int(self.surface is not None)
        values["FURCL_MESHES"] = int(self.meshes is not None)
        values["FURCL_LEARNING"] = int(self.learning is not None)
        values["FURCL_ENVIRONMENT"] = int(self.light is not None)
        values["FURCL_LIGHT_AT_INFINITY"] = int(self.light_at_infinity)
        values["FURCL_SHADOW_DISTANCES"] = int(self.shadow_distances)
        values |= NO_SAMPLER | NO_LAMPS | NO_MESHES | NO_LAYERS
        for part in self.parts.values():
            values |= part.defines()
        values["FURCL_LAYERS_OF_LOBES"] = self._layers_of_lobes()
        return values

    @property
    def lobe_layers(self) -> tuple[str, ...]:
        """Names of the lobes that have layers of their own."""
        return getattr(self.layers, "lobes", ())

    @property
    def light_layers(self) -> bool:
        """Whether there are layers of scattered light."""
        return bool(getattr(self.layers, "of_light", False))

    def has_layer(self, *names: str) -> bool:
        """Whether there is one of these layers."""
        return any(name in getattr(self.layers, "names", ()) for name in names)

    def _layers_of_lobes(self) -> str:
        """Four bits for each lobe of the fibre: the number of its layer."""
        lobes = getattr(getattr(self.fibre, "model", None), "lobes", ())
        places = [(4 * i, lobe.name) for i, lobe in enumerate(lobes)]
        index = self.lobe_layers.index
        word = sum(index(name) << at for at, name in places if name in self.lobe_layers)
        return f"{word:#x}ul"

    def structs(self) -> dict[str, Fields]:
        """Structs of the parts."""
        return {k: v for part in self.parts.values() for k, v in part.structs().items()}

    def with_(self, **changes: Any) -> Features:
        """A copy with some fields changed."""
        return replace(self, **changes)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON and image headers: the parts' names and values among the others."""
        plain = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in PARTS}
        for kind, name in PLAIN_NAMES.items():
            part = getattr(self, kind)
            plain[name] = part.name if part else None
            plain |= part.as_dict() if part else {}
        return plain

    def describe(self) -> str:
        """One line for messages and logs."""
        return ", ".join(f"{name} {value}" for name, value in self.as_dict().items())


# What a sampler's part defines, for kernels without one; and what other kernels ask of layers.
NO_SAMPLER = {"FURCL_TABLES": 0, "FURCL_PROFILE_ANGLES": 0, "FURCL_ALL_LOBES": 0}
NO_LAYERS = {
    f"FURCL_{name}": 0
    for name in (
        "FIRST_HITS",
        "LIGHT_LAYERS",
        "SPLIT_DIRECT",
        "LOBE_LAYERS",
        *(f"LAYER_{layer.upper()}" for layer in LAYERS),
    )
}


# What the part of lamps defines, for scenes without any.
NO_LAMPS = {f"FURCL_{name}": 0 for name in ("LAMPS", "AREA_LAMPS", "LAMP_DISTANT", "LAMP_TRIANGLE")}

# What the part of meshes defines, for kernels without them.
NO_MESHES = {f"FURCL_MESH_{name}": 0 for name in ("NORMALS", "TEXTURES", "EMISSION", "COAT")}

PARTS = ("fibre", "sampler", "light", "lamps", "surface", "meshes", "learning", "layers")
PLAIN_NAMES = {
    "fibre": "model",
    "sampler": "sampling",
    "light": "environment",
    "lamps": "lamps",
    "surface": "body",
    "meshes": "meshes",
    "learning": "learning",
    "layers": "layers",
}
