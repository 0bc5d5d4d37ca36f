"""Hair on an ellipsoidal scalp: straight, wavy or curly."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from furcl.errors import GroomError
from furcl.groom.attributes import CLUMP, clump_values
from furcl.groom.curves import Curves, adopted
from furcl.groom.grow import strands
from furcl.groom.grow.locks import Clumps, Rng, Waves
from furcl.groom.grow.nearest import nearest
from furcl.groom.grow.ranges import HAIR_RANGES, check, check_size
from furcl.groom.grow.scalp import Combing, grow, lock_features, scalp_roots
from furcl.groom.grow.strands import Block, Ellipsoid

# wave_amplitude [unit], wave_frequency [turns / unit], helix
STYLES = {
    "straight": (0.020, 0.5, 0.5),
    "wavy": (0.045, 1.6, 0.4),
    "curly": (0.075, 2.4, 0.9),
}
POINTS_PER_TURN = 10
LEAST_POINTS_PER_TURN = 6
MOST_POINTS = HAIR_RANGES["n_points"][1]
LOCKS_PER_CLUMP = 10


def hair(
    *,
    n_strands: int = 40_000,
    n_points: int | None = None,
    seed: int = 1,
    scalp_centre: Sequence[float] = (0.0, 0.0, 0.0),
    scalp_radii: Sequence[float] = (0.85, 1.0, 0.95),
    hairline_front_deg: float = 42.0,
    hairline_side_deg: float = 5.0,
    hairline_back_deg: float = -35.0,
    style: str = "straight",
    length: float = 2.0,
    length_variation: float = 0.25,
    radius: float = 0.0009,
    radius_variation: float = 0.15,
    tip_radius: float = 0.4,
    lift_deg: float = 35.0,
    parting: float = 0.7,
    parting_x: float = 0.25,
    comb_back: float = 0.6,
    gravity: float = 3.0,
    volume: float = 0.12,
    n_clumps: int = 250,
    clumping: float = 0.85,
    wave_amplitude: float | None = None,
    wave_frequency: float | None = None,
    helix: float | None = None,
    frizz: float = 0.006,
    flyaways: float = 0.02,
) -> Curves:
    """Grow hair on the upper part of an ellipsoid.

    z is up and the face looks along -y. A unit is about the radius of the scalp, 9 cm of a human
    head; a real head has 100 000 hairs of radius 0.0004, so fewer hairs are made thicker. Strands
    are grown along a combed direction that gravity turns down, slide over the scalp, are drawn
    to locks and to clumps of locks, then waved. No point lies inside the scalp, and no segment as
    long as segments are shorter than a quarter of the smallest scalp radius. The same parameters
    give the same bits with the same numpy on the same kind of processor.

    Parameters
    ----------
    n_strands : int              strands, 1 .. 5e7
    n_points : int               points a strand; if left out enough for length and waves, 2 .. 4096
    seed : int                   of the random numbers, 0 .. 2^63 - 1
    scalp_centre : (3,)          centre of the scalp, x y z, -1e6 .. 1e6 [unit]
    scalp_radii : (3,)           half axes of the scalp, x y z, 1e-3 .. 1e3 [unit]
    hairline_front_deg : float   elevation of the hairline in front, seen from the scalp's centre,
                                 -90 .. 90 [deg]
    hairline_side_deg : float    its elevation at the sides, -90 .. 90 [deg]
    hairline_back_deg : float    its elevation behind, -90 .. 90 [deg]
    style : str                  "straight", "wavy" or "curly": sets those of wave_amplitude,
                                 wave_frequency and helix that are left out
    length : float               of the longest strands, along their axis, 1e-4 .. 100 [unit]
    length_variation : float     v: lengths are uniform in length * [1 - v, 1], 0 .. 0.95
    radius : float               at the root, 1e-7 .. 1 [unit]
    radius_variation : float     v: relative, uniform in [1 - v, 1 + v], 0 .. 0.9
    tip_radius : float           fraction of the root's, 0.01 .. 1
    lift_deg : float             angle of the root above the scalp, 0 .. 90 [deg]
    parting : float              weight of combing away from the parting, 0 .. 1
    parting_x : float            place of the parting, fraction of scalp_radii[0], -0.9 .. 0.9
    comb_back : float            weight of combing backwards, 0 .. 1
    gravity : float              turn towards -z, 0 .. 100 [rad / unit of length]
    volume : float               height of the top layer above the scalp, 0.005 .. 1 [unit]
    n_clumps : int               clumps of about ten locks each; 0: none, 0 .. 1e6
    clumping : float             pull of the clump at the tip, 0 .. 1
    wave_amplitude : float       of the waves or curls; that of the style if left out, 0 .. 1
                                 [unit]
    wave_frequency : float       that of the style if left out, 0 .. 100 [turns / unit of length]
    helix : float                0: a flat wave, 1: a round helix; that of the style if left out,
                                 0 .. 1
    frizz : float                wander of single strands at the tip, 0 .. 1 [unit]
    flyaways : float             fraction of strands that leave their clump, 0 .. 1

    Returns
    -------
    Curves                       with n_clumps the attribute "clump" of each strand, a number of 0
                                 to 1 that strands of a clump share

    Raises
    ------
    GroomError                   a parameter outside its range, too few points for the waves, or
                                 more of them wanted than are grown
    """
    check("hair", HAIR_RANGES, locals())
    given = (wave_amplitude, wave_frequency, helix)
    waving = [s if g is None else g for s, g in zip(STYLES[style], given, strict=True)]
    turns = length * waving[1] if waving[0] > 0.0 else 0.0
    k = _points_per_strand(n_points, length / min(scalp_radii), turns)
    check_size("hair", n_strands, k, n_clumps)
    rng = np.random.default_rng(seed)
    solid = Ellipsoid(_column(scalp_centre), _column(scalp_radii))
    hairline = (hairline_front_deg, hairline_side_deg, hairline_back_deg)
    combing = Combing(np.radians(lift_deg), parting, parting_x, comb_back, gravity, volume)

    roots = scalp_roots(n_strands, solid, hairline, rng)
    locks, waves = None, Waves.random(n_clumps or n_strands, rng)
    parent_idx = clump_of_lock = np.arange(n_strands)
    if n_clumps > 0:
        places = [scalp_roots(n, solid, hairline, rng) for n in _level_sizes(n_clumps, n_strands)]
        features = [lock_features(r, solid, combing) for r in (*places, roots)]
        clump_of_lock, parent_idx = nearest(*features[:2]), nearest(*features[1:])
        grown = [
            grow(p.T, np.full(len(p), length, np.float32), k, solid, combing, rng) for p in places
        ]
        locks = _locks(grown, clump_of_lock, parent_idx, length, clumping, rng)
        waves = waves.children(clump_of_lock, 0.4, rng)
    lengths = length * (1.0 - np.float32(length_variation) * rng.random(n_strands, np.float32))
    widths = 1.0 + radius_variation * rng.uniform(-1.0, 1.0, n_strands)

    points = np.empty((n_strands, k, 3), dtype=np.float32)
    for begin in range(0, n_strands, strands.BLOCK_STRANDS):
        own = slice(begin, begin + strands.BLOCK_STRANDS)
        block = grow(roots[own].T, lengths[own], k, solid, combing, rng)
        n = block.shape[2]
        stray = rng.random(n, np.float32) < flyaways
        if locks is not None:
            pull = clumping * np.where(stray, 0.15, rng.uniform(0.6, 1.0, n))
            locks.draw(block, own, lengths[own], _pull_profile(k) * strands.float32(pull))
        if turns > 0.0:
            own_waves = waves.children(parent_idx[own], 0.15, rng)
            _wave(block, own_waves, waving, lengths[own])
        wander = frizz * np.where(stray, 6.0, rng.uniform(0.4, 1.6, n))
        strands.frizz(block, strands.float32(wander), rng)
        strands.keep_out(block, solid, lengths[own] / np.float32(k - 1))
        points[own] = block.transpose(2, 0, 1)

    radii = strands.tapered_radii(k, strands.float32(radius * widths), tip_radius, power=3.0)
    clumps = {} if locks is None else {CLUMP: clump_values(clump_of_lock[parent_idx])}
    return adopted(points, radii, source="hair", attributes=clumps)


def _column(values) -> Block:
    return strands.float32(values)[:, None]


def _points_per_strand(n_points, relative_length, turns):
    """Points of a strand: enough for its waves and to follow the scalp."""
    if n_points is None:
        wanted = 1 + max(12, int(np.ceil(POINTS_PER_TURN * turns)), int(12 * relative_length))
        if wanted > MOST_POINTS:
            raise GroomError(
                f"hair: strands {relative_length:.3g} times as long as the least of scalp_radii, "
                f"with {turns:.3g} turns of the wave, want {wanted} points each; at most "
                f"{MOST_POINTS} are grown. Lower length or wave_frequency, raise scalp_radii, or "
                f"give n_points."
            )
        return wanted
    if n_points - 1 < LEAST_POINTS_PER_TURN * turns:
        raise GroomError(
            f"hair: n_points = {n_points} is too few for {turns:.3g} turns of the wave a strand; "
            f"at least {LEAST_POINTS_PER_TURN} segments a turn are needed. Leave n_points out, "
            "lower wave_frequency or length, or set wave_amplitude = 0."
        )
    return n_points


def _level_sizes(n_clumps, n_strands):
    return n_clumps, max(n_clumps, min(LOCKS_PER_CLUMP * n_clumps, n_strands))


def _pull_profile(n_points):
    """Weight (k, 1) of the guide along a strand: 0 at the root, nearly 1 from the middle on."""
    s = np.linspace(0.0, 1.0, n_points, dtype=np.float32)[:, None]
    return s * (2.0 - s)


def _locks(grown, clump_idx, lock_idx, length, clumping, rng: Rng) -> Clumps:
    """Locks, from the guides of clumps and of locks, which are drawn to those of the clumps."""
    clump_guides, lock_guides = grown
    lengths = [np.full(block.shape[2], length, np.float32) for block in grown]
    pull = clumping * rng.uniform(0.2, 0.8, len(clump_idx))
    weight = _pull_profile(len(lock_guides)) * strands.float32(pull)
    Clumps(clump_guides, lengths[0], clump_idx).draw(lock_guides, slice(None), lengths[1], weight)
    return Clumps(lock_guides, lengths[1], lock_idx)


def _wave(block, waves: Waves, waving, length: NDArray):
    amplitude, frequency, helix = waving
    rate = np.float32(2.0 * np.pi * frequency) * waves.rate
    depth = np.float32(amplitude) * waves.depth
    strands.wave(block, depth, rate, waves.phase, waves.side.T, helix, length)
