"""The tables of lamps, [lamp.NAME] or [[lamp]], and the lamps that they describe.

Unplaced, a lamp is at the origin and shines along -z.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from furcl.errors import LightError
from furcl.light.lamps import planar
from furcl.light.lamps.lamps import Lamps
from furcl.light.lamps.point import spot_solid_angle
from furcl.light.lamps.record import Array, Records, records
from furcl.scene.transform import Transform
from furcl.surface.mesh.mesh import Mesh, Meshes
from furcl.table import Length, Rgb, Table, Vec3, triple

Amount = Annotated[float, Meta(ge=0.0, le=1e15)]

# Radiance, intensity or irradiance of a lamp that float32 still sums the squares of.
LARGEST = 1e15


class Lamp(Table, frozen=True, kw_only=True):
    """Base of the tables of lamps.

    Attributes
    ----------
    colour : (r,g,b)        factor on its light; one number stands for three equal ones
    position : (x, y, z)    where it is; the origin if left out [unit]
    target : (x, y, z)      what it shines at; along -z if left out [unit]
    transform : table       its place, instead of position and target
    """

    allowed: ClassVar = {"colour": (0.0, 1e6)}

    colour: Rgb = 1.0
    position: Vec3 | None = None
    target: Vec3 | None = None
    transform: Transform = Transform()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.target is not None and self.target == (self.position or (0.0, 0.0, 0.0)):
            raise ValueError(
                f"target = {self.target}: the lamp is there; give another position or target"
            )
        given = [name for name in ("position", "target") if getattr(self, name) is not None]
        if given and not self.transform.is_identity:
            raise ValueError(
                f"{' and '.join(given)} = a place beside transform; give one or the other"
            )
        self._check()

    def _check(self) -> None:
        """ValueError where values that are each allowed do not go together."""

    @abstractmethod
    def records(self) -> Records:
        """The lamp, placed."""

    def light(self, amount: float) -> Array:
        """Its light (3,): an amount by its colour."""
        return amount * np.array(triple(self.colour), np.float64)

    def matrix(self) -> NDArray[np.float64]:
        """From the lamp's own space to the world, (4, 4)."""
        if self.position is None and self.target is None:
            return self.transform.as_matrix()
        out = np.eye(4)
        position = np.array(self.position or (0.0, 0.0, 0.0), np.float64)
        if self.target is not None:
            out[:3, :3] = _turned(np.array(self.target, np.float64) - position)
        out[:3, 3] = position
        return out

    @property
    def axis(self) -> Array:
        """Unit vector (3,) along which it shines."""
        return -_unit(self.matrix()[:3, 2])


class QuadLamp(Lamp, frozen=True, kw_only=True, tag_field="kind", tag="quad"):
    """Rectangle that shines alike in all directions of its front side.

    Rays see it and stop at it, at its dark back too.

    Attributes
    ----------
    size : (width, height)  along its x and y [unit]
    radiance : float        what a ray that meets it brings; this or power
    power : float           that it sends out, of each channel: pi times radiance and area [radiance
                            times sr unit^2]
    two_sided : bool        its back shines like its front
    """

    described_by: ClassVar = Lamp

    size: tuple[Length, Length] = (1.0, 1.0)
    radiance: Amount | None = None
    power: Amount | None = None
    two_sided: bool = False

    def _check(self) -> None:
        _check_one(radiance=self.radiance, power=self.power)

    def records(self) -> Records:
        return _flat(self, "quad", 0.5 * self.size[0], 0.5 * self.size[1])


class DiskLamp(Lamp, frozen=True, kw_only=True, tag_field="kind", tag="disk"):
    """Disk that shines alike in all directions of its front side.

    Rays see it and stop at it, at its dark back too.

    Attributes
    ----------
    radius : float          of the disk [unit]
    radiance : float        what a ray that meets it brings; this or power
    power : float           that it sends out, of each channel: pi times radiance and area [radiance
                            times sr unit^2]
    two_sided : bool        its back shines like its front
    """

    described_by: ClassVar = Lamp

    radius: Length = 0.5
    radiance: Amount | None = None
    power: Amount | None = None
    two_sided: bool = False

    def _check(self) -> None:
        _check_one(radiance=self.radiance, power=self.power)

    def records(self) -> Records:
        return _flat(self, "disk", self.radius, self.radius)


class SphereLamp(Lamp, frozen=True, kw_only=True, tag_field="kind", tag="sphere"):
    """Sphere that shines outwards alike in all directions. Rays see it and stop at it.

    Attributes
    ----------
    radius : float          of the sphere [unit]
    radiance : float        what a ray that meets it brings; this or power
    power : float           that it sends out, of each channel: pi times radiance and surface
                            [radiance times sr unit^2]
    """

    described_by: ClassVar = Lamp

    radius: Length = 0.5
    radiance: Amount | None = None
    power: Amount | None = None

    def _check(self) -> None:
        _check_one(radiance=self.radiance, power=self.power)

    def records(self) -> Records:
        radius = self.radius * self.transform.uniform_scale()
        surface = 4.0 * math.pi * radius**2
        radiance = _radiance(self, self.radiance, self.power, math.pi * surface)
        return records(
            "sphere",
            centre=self.matrix()[:3, 3],
            extent=radius,
            axis=(0.0, 0.0, 1.0),
            radiance=self.light(radiance),
        )


class PointLamp(Lamp, frozen=True, kw_only=True, tag_field="kind", tag="point"):
    """Point that shines alike in all directions. Rays do not see it.

    Attributes
    ----------
    intensity : float       power per solid angle; this or power [radiance times unit^2]
    power : float           that it sends out, of each channel: 4 pi times intensity [radiance times
                            sr unit^2]
    """

    described_by: ClassVar = Lamp

    intensity: Amount | None = None
    power: Amount | None = None

    def _check(self) -> None:
        _check_one(intensity=self.intensity, power=self.power)

    def records(self) -> Records:
        intensity = _radiance(self, self.intensity, self.power, 4.0 * math.pi)
        return records(
            "point",
            centre=self.matrix()[:3, 3],
            axis=(0.0, 0.0, 1.0),
            radiance=self.light(intensity),
        )


class SpotLamp(Lamp, frozen=True, kw_only=True, tag_field="kind", tag="spot"):
    """Point that shines into a cone with a soft edge. Rays do not see it.

    Attributes
    ----------
    cone_deg : float        from the axis to where its light ends [deg]
    edge_deg : float        width of the soft edge, inside the cone [deg]
    intensity : float       power per solid angle within the edge; this or power [radiance times
                            unit^2]
    power : float           that it sends out, of each channel [radiance times sr unit^2]
    """

    described_by: ClassVar = Lamp

    cone_deg: Annotated[float, Meta(ge=0.01, le=180.0)] = 30.0
    edge_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 5.0
    intensity: Amount | None = None
    power: Amount | None = None

    def _check(self) -> None:
        _check_one(intensity=self.intensity, power=self.power)
        if self.edge_deg > self.cone_deg:
            raise ValueError(
                f"edge_deg = {self.edge_deg:g}: allowed is 0 to cone_deg = {self.cone_deg:g}, "
                f"in which the edge lies"
            )

    def records(self) -> Records:
        outer = math.cos(math.radians(self.cone_deg))
        inner = math.cos(math.radians(self.cone_deg - self.edge_deg))
        solid_angle = spot_solid_angle(inner, outer)
        return records(
            "spot",
            centre=self.matrix()[:3, 3],
            axis=self.axis,
            cos_inner=inner,
            cos_outer=outer,
            radiance=self.light(_radiance(self, self.intensity, self.power, solid_angle)),
        )


class DistantLamp(Lamp, frozen=True, kw_only=True, tag_field="kind", tag="distant"):
    """Light from one direction, or from a small cone of them, as of a sun.

    Rays that leave the scene see it where it has an angle.

    Attributes
    ----------
    angle_deg : float       angle that its disk fills as seen from the scene; 0 is a single
                            direction [deg]
    irradiance : float      of a surface that faces it; this or radiance [radiance times sr]
    radiance : float        what a ray that leaves the scene within its disk brings
    """

    described_by: ClassVar = Lamp

    angle_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.53
    irradiance: Amount | None = None
    radiance: Amount | None = None

    def _check(self) -> None:
        _check_one(irradiance=self.irradiance, radiance=self.radiance)
        if self.angle_deg == 0.0 and self.radiance is not None:
            raise ValueError(
                "radiance = a number with angle_deg = 0: a single direction has no radiance; give "
                "irradiance, or an angle"
            )

    def records(self) -> Records:
        radius = math.radians(0.5 * self.angle_deg)
        extent = 2.0 * math.sin(0.5 * radius) ** 2
        amount = self.irradiance
        if self.angle_deg > 0.0:
            facing = math.pi * math.sin(radius) ** 2
            amount = _radiance(self, self.radiance, self.irradiance, facing)
        return records("distant", axis=self.axis, extent=extent, radiance=self.light(amount or 0.0))


TABLES: tuple[type[Lamp], ...] = (
    QuadLamp, DiskLamp, SphereLamp, PointLamp, SpotLamp, DistantLamp,
)  # fmt: skip


def tables() -> dict[str, type[Lamp]]:
    """Kind -> type of its table in scenes."""
    return {str(table.__struct_config__.tag): table for table in TABLES}


def build(
    lamps: Mapping[str, Lamp], by_position: bool = True, meshes: Meshes | None = None
) -> Lamps | None:
    """The lamps of tables by name, then the triangles of meshes that emit light; None where there
    are none.

    Raises
    ------
    LightError      a lamp without extent where one is needed, or brighter than LARGEST; too many
    """
    parts = [_checked(name, lamp) for name, lamp in lamps.items()]
    parts += [_triangles(mesh) for mesh in (meshes.lamps if meshes else [])]
    return Lamps.make(parts, by_position) if parts else None


def _triangles(mesh: Mesh) -> Records:
    """The triangles of a mesh as lamps, all of them and in their order."""
    a, b, c = np.moveaxis(mesh.triangles.corners.astype(np.float64), 1, 0)
    return planar.flat("triangle", a, b - a, c - a, mesh.emission)


def _checked(name: str, lamp: Lamp) -> Records:
    kind = lamp.__struct_config__.tag
    try:
        found = lamp.records()
    except ValueError as error:
        raise LightError(f"lamp.{name}.transform {error}") from None
    if not len(found):
        raise LightError(f"lamp.{name}: a {kind} of no area in float64; give it a larger size")
    brightest = float(found["radiance"].max())
    if not brightest <= LARGEST:
        raise LightError(
            f"lamp.{name}: a {kind} of radiance or intensity {brightest:g}; at most {LARGEST:g} "
            f"is rendered, since the variance holds squares in float32; make it weaker or larger"
        )
    return found


def _check_one(**amounts: float | None) -> None:
    """ValueError unless exactly one of two ways to say how bright a lamp is was taken."""
    given = [name for name, value in amounts.items() if value is not None]
    if len(given) != 1:
        names = " or ".join(amounts)
        found = "both are" if given else "neither is"
        raise ValueError(f"{found} given of {names}; give one of them")


def _radiance(lamp: Lamp, direct: float | None, whole: float | None, factor: float) -> float:
    """What is said directly, or else follows from the whole of it, which is `factor` times that."""
    return direct if direct is not None else (whole or 0.0) / max(factor, 1e-300)


def _flat(lamp: QuadLamp | DiskLamp, kind: str, half_x: float, half_y: float) -> Records:
    matrix = lamp.matrix()
    a, b = half_x * matrix[:3, 0], half_y * matrix[:3, 1]
    area = planar.AREAS[kind] * float(np.linalg.norm(np.cross(a, b)))
    sides = 2.0 if lamp.two_sided else 1.0
    radiance = _radiance(lamp, lamp.radiance, lamp.power, math.pi * area * sides)
    # It shines along -z, and keeps that side where the transform mirrors it.
    mirrored = float(np.linalg.det(matrix[:3, :3])) < 0.0
    return planar.flat(
        kind,
        matrix[:3, 3],
        a,
        b,
        lamp.light(radiance),
        two_sided=lamp.two_sided,
        flip=not mirrored,
    )


def _turned(way: Array) -> Array:
    """A rotation (3, 3) of -z to a direction (3,), with x level."""
    z = -_unit(way)
    side = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    x = _unit(np.cross(side, z))
    return np.stack([x, np.cross(z, x), z], axis=1)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)
