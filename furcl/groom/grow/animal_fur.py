"""Fur on a sphere or on a flat patch."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from furcl.errors import GroomError
from furcl.groom.attributes import CLUMP, clump_values
from furcl.groom.curves import Curves, adopted
from furcl.groom.grow import strands
from furcl.groom.grow.locks import Clumps, Rng
from furcl.groom.grow.nearest import nearest
from furcl.groom.grow.ranges import FUR_RANGES, check, check_size
from furcl.groom.grow.roots import noise_map, thinned, unit_directions
from furcl.groom.grow.strands import Block, Ellipsoid, HalfSpace

# The undercoat is crimped and stands up more than the guard hairs.
UNDERCOAT_FRIZZ = 2.0
UNDERCOAT_LEAN = 0.7


@dataclass(frozen=True)
class _Coat:
    """Strands before clumps and frizz, one row each."""

    roots: Block  # (n, 3)
    normal: Block  # (n, 3)
    comb: Block  # (n, 3) tangent, length 0 .. 1: how far the strand follows lean and bend
    length: Block  # (n,)


def fur(
    *,
    n_strands: int = 100_000,
    n_points: int = 8,
    seed: int = 1,
    surface: str = "sphere",
    centre: Sequence[float] = (0.0, 0.0, 0.0),
    sphere_radius: float = 1.0,
    patch_size: Sequence[float] = (2.0, 2.0),
    length: float = 0.2,
    length_variation: float = 0.3,
    length_noise: float = 0.3,
    length_noise_scale: float = 1.0,
    density_noise: float = 0.3,
    density_noise_scale: float = 2.0,
    radius: float = 0.0015,
    radius_variation: float = 0.2,
    tip_radius: float = 0.08,
    comb: Sequence[float] = (0.4, -0.3, -0.85),
    lean_deg: float = 45.0,
    bend_deg: float = 40.0,
    comb_noise_deg: float = 20.0,
    comb_noise_scale: float = 1.0,
    n_clumps: int = 4000,
    clumping: float = 0.35,
    frizz: float = 0.004,
    undercoat: float = 0.4,
    undercoat_length: float = 0.5,
    undercoat_radius: float = 0.6,
) -> Curves:
    """Grow fur on a sphere, or on a rectangle in the plane z = centre[2] whose normal is +z.

    Strands lean and bend towards the combing direction, whose swirls, as well as the maps of
    length and density, are smooth seeded noise. Where the combing direction is normal to the
    surface strands stand up. No point lies under the surface. The same parameters give the same
    bits with the same numpy on the same kind of processor.

    Parameters
    ----------
    n_strands : int              strands, 1 .. 5e7
    n_points : int               points a strand, 2 .. 4096
    seed : int                   of the random numbers, 0 .. 2^63 - 1
    surface : str                what it grows on: a "sphere" or a flat "patch"
    centre : (3,)                of the sphere or the patch, -1e6 .. 1e6 [unit]
    sphere_radius : float        of the sphere, 1e-3 .. 1e3 [unit]
    patch_size : (2,)            of the patch in x and y, 1e-3 .. 1e3 [unit]
    length : float               of the longest strands, 1e-4 .. 100 [unit]
    length_variation : float     v: lengths are uniform in [1 - v, 1] times the map, 0 .. 0.95
    length_noise : float         depth of the map of length, whose values are 1 - depth to 1,
                                 0 .. 0.95
    length_noise_scale : float   of that map, 0.01 .. 1e3 [waves / unit]
    density_noise : float        depth of the map of density, whose values are 1 - depth to 1,
                                 0 .. 0.95
    density_noise_scale : float  of that map, 0.01 .. 1e3 [waves / unit]
    radius : float               at the root, 1e-7 .. 1 [unit]
    radius_variation : float     v: relative, uniform in [1 - v, 1 + v], 0 .. 0.9
    tip_radius : float           fraction of the root's, 0.01 .. 1
    comb : (3,)                  combing direction of any length but 0, -1e6 .. 1e6
    lean_deg : float             angle between the strand's root and the normal, 0 .. 85 [deg]
    bend_deg : float             further turn up to the tip, -90 .. 120 [deg]
    comb_noise_deg : float       standard deviation of the swirl, 0 .. 180 [deg]
    comb_noise_scale : float     of the swirl, 0.01 .. 1e3 [waves / unit]
    n_clumps : int               clumps; 0: none, 0 .. 1e6
    clumping : float             pull of the clump at the tip, 0 .. 1
    frizz : float                wander of the longest strands at the tip, 0 .. 1 [unit]
    undercoat : float            fraction of the strands that are undercoat, 0 .. 1
    undercoat_length : float     relative to the others, 0.01 .. 1
    undercoat_radius : float     relative to the others, 0.01 .. 1

    Returns
    -------
    Curves                       with n_clumps the attribute "clump" of each strand, a number of 0
                                 to 1 that strands of a clump share

    Raises
    ------
    GroomError                   a parameter outside its range
    """
    check("fur", FUR_RANGES, locals())
    check_size("fur", n_strands, n_points, n_clumps)
    if not any(comb):
        raise GroomError(
            "fur: comb = (0, 0, 0) is no direction; give one, lean_deg = 0 is upright."
        )
    rng, noise = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    maps = _Maps(
        surface,
        np.asarray(centre, np.float64),
        np.array([sphere_radius] * 3 if surface == "sphere" else [*patch_size, 0.0]),
        np.asarray(comb, np.float64) / np.linalg.norm(comb),
        (density_noise, density_noise_scale, noise.integers(2**63)),
        (length_noise, length_noise_scale, noise.integers(2**63)),
        (np.radians(comb_noise_deg), comb_noise_scale, noise.integers(2**63)),
    )
    coat = maps.coat(n_strands, length, rng)
    under = rng.random(n_strands, np.float32) < undercoat
    lengths = coat.length * rng.uniform(1.0 - length_variation, 1.0, n_strands)
    lengths = strands.float32(lengths * np.where(under, undercoat_length, 1.0))
    angles = np.radians(lean_deg), np.radians(bend_deg)
    clumps = None
    if n_clumps > 0:
        tufts = maps.coat(n_clumps, length, rng)
        grown = _grow(tufts, slice(None), tufts.length, angles, n_points, rng)
        clumps = Clumps(grown, tufts.length, nearest(tufts.roots, coat.roots))

    points = np.empty((n_strands, n_points, 3), dtype=np.float32)
    profile = np.linspace(0.0, 1.0, n_points, dtype=np.float32)[:, None] ** 1.5
    for begin in range(0, n_strands, strands.BLOCK_STRANDS):
        own = slice(begin, begin + strands.BLOCK_STRANDS)
        lean = angles[0] * np.where(under[own], UNDERCOAT_LEAN, 1.0)
        block = _grow(coat, own, lengths[own], (lean, angles[1]), n_points, rng)
        n = block.shape[2]
        if clumps is not None:
            pull = profile * strands.float32(clumping * rng.uniform(0.5, 1.0, n))
            clumps.draw(block, own, lengths[own], pull)
        wander = frizz * np.where(under[own], UNDERCOAT_FRIZZ, rng.uniform(0.4, 1.6, n))
        wander *= lengths[own] / length
        strands.frizz(block, strands.float32(wander), rng)
        strands.keep_out(block, maps.solid(), lengths[own] / np.float32(n_points - 1))
        points[own] = block.transpose(2, 0, 1)

    widths = rng.uniform(1.0 - radius_variation, 1.0 + radius_variation, n_strands)
    widths = strands.float32(radius * widths * np.where(under, undercoat_radius, 1.0))
    radii = strands.tapered_radii(n_points, widths, tip_radius, power=1.5)
    attributes = {} if clumps is None else {CLUMP: clump_values(clumps.idx)}
    return adopted(points, radii, source="fur", attributes=attributes)


@dataclass(frozen=True)
class _Maps:
    """The surface and the noise over it; a noise is (depth, waves a unit, seed)."""

    surface: str
    centre: np.ndarray
    size: np.ndarray
    comb: np.ndarray
    density: tuple
    length: tuple
    swirl: tuple

    def place(self, square):
        """Points and normals (n, 3) of the surface at points (n, 2) of the unit square."""
        if self.surface == "sphere":
            normal = unit_directions(square)
            return self.centre + normal * self.size, normal
        flat = np.column_stack([square - 0.5, np.zeros(len(square))])
        return self.centre + flat * self.size, np.broadcast_to([0.0, 0.0, 1.0], flat.shape)

    def solid(self) -> Ellipsoid | HalfSpace:
        """What strands stay out of."""
        if self.surface == "patch":
            return HalfSpace(np.float32(self.centre[2]))
        return Ellipsoid(*(strands.float32(v)[:, None] for v in (self.centre, self.size)))

    def coat(self, n: int, length: float, rng: Rng) -> _Coat:
        """n strands spread by the density map, with lengths by the length map."""
        square = thinned(n, lambda sq: _relative(self.density, self.place(sq)[0]), rng)
        points, normal = self.place(square)
        along = self.comb - normal * (normal @ self.comb)[:, None]
        deviation, scale, seed = self.swirl
        angle = deviation * noise_map(points, scale, np.random.default_rng(seed))[:, None]
        along = along * np.cos(angle) + np.cross(normal, along) * np.sin(angle)
        # Strands follow fully where the combing is within 45 degrees of the surface.
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.sqrt(0.5))
        lengths = length * _relative(self.length, points)
        return _Coat(*(strands.float32(v) for v in (points, normal, along, lengths)))


def _relative(noise, points):
    """A map in [1 - depth, 1]."""
    depth, scale, seed = noise
    if depth == 0.0:
        return np.ones(len(points))
    value = noise_map(points, scale, np.random.default_rng(seed))
    return 1.0 - depth * (0.5 + 0.5 * np.tanh(value))


def _grow(coat: _Coat, own: slice, length, angles, n_points: int, rng: Rng) -> Block:
    """Strands (k, 3, b) in the planes of normal and combing, turning evenly from root to tip."""
    normal, comb = coat.normal[own].T, coat.comb[own].T
    n = normal.shape[1]
    strength = np.sqrt(strands.dot(comb, comb))
    along = comb + 0.12 * rng.standard_normal((3, n), dtype=np.float32)
    along = strands.normalised(along - strands.dot(along, normal) * normal)
    lean, bend = (strands.float32(a) * strength for a in angles)
    lean = lean + 0.12 * rng.standard_normal(n, dtype=np.float32)
    step = length / np.float32(n_points - 1)
    block = np.empty((n_points, 3, n), dtype=np.float32)
    block[0] = coat.roots[own].T
    for j in range(1, n_points):
        angle = lean + bend * np.float32((j - 0.5) / (n_points - 1))
        block[j] = block[j - 1] + step * (np.cos(angle) * normal + np.sin(angle) * along)
    return block
