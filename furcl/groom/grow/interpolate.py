"""Children of guide strands: most grooms that people share are guides, a few thousand strands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from furcl.groom.attributes import CLUMP, clump_values
from furcl.groom.curves import Curves, adopted
from furcl.groom.grow import strands
from furcl.groom.grow.ranges import check_size
from furcl.groom.grow.strands import Block

NEIGHBOURS = 6
"""Guides around a guide that its children lie between."""


def children(
    guides: Curves,
    *,
    n_strands: int,
    n_points: int | None = None,
    seed: int = 1,
    clumping: float = 0.0,
    spread_deg: float = 60.0,
    length_variation: float = 0.1,
    frizz: float = 0.0,
    radius: float | None = None,
    radius_variation: float = 0.0,
    roots: NDArray[np.floating] | None = None,
    source: str = "interpolate",
) -> Curves:
    """Strands between guides.

    A child has a guide of its own and lies between that and two of the guides next to it: its root
    and, from root to tip, its way from the root are means of theirs with the same weights, which
    are uniform in the triangle where its own guide has the largest. All guides have as many
    children, one more or less. Where roots are given, a child's own guide is the one next to its
    root, and the weights fall with the square of the distance from its root to those of the guides.
    Children are grown 8192 at a time; the same parameters give the same bits with the same numpy.

    Parameters
    ----------
    guides : Curves
    n_strands : int             children
    n_points : int or None      points a child, even in length; None: as many as guides have at most
    seed : int                  of the random numbers
    clumping : float            pull towards its own guide at the tip, growing from the root, 0 .. 1
    spread_deg : float          guides that go elsewhere, by so much between root and tip, give
                                a child nothing: a parting stays one [deg]
    length_variation : float    v: children are cut to a length uniform in [1 - v, 1] of what the
                                guides make
    frizz : float               wander at the tip, of the longest guides' length
    radius : float or None      at the root [unit]; None: that of the guides
    radius_variation : float    v: relative, uniform in [1 - v, 1 + v]
    roots : (n_strands, 3)      of the children, such as those of furcl.groom.grow.mesh_roots
                                [unit]; None: between the guides'
    source : str                name in messages

    Returns
    -------
    Curves                      values of strands are those of the child's own guide, with "clump",
                                a number of 0 to 1 for each guide; values of points are not passed
                                on

    Raises
    ------
    GroomError                  more points than can be indexed
    """
    k = int(np.diff(guides.offsets).max()) if n_points is None else n_points
    check_size(source, n_strands, k)
    rng = np.random.default_rng(seed)
    shapes, shape_radii, lengths = _resampled(guides, k)
    around = _neighbours(guides, shapes, spread_deg)
    if roots is None:
        own = np.resize(rng.permutation(guides.n_strands), n_strands)
    else:
        own = np.asarray(KDTree(shapes[:, 0]).query(roots)[1], np.int64)
    pull = np.float32(clumping) * np.linspace(0.0, 1.0, k, dtype=np.float32)[:, None] ** 1.5
    points = np.empty((n_strands, k, 3), np.float32)
    radii = np.empty((n_strands, k), np.float32)
    for begin in range(0, n_strands, strands.BLOCK_STRANDS):
        part = slice(begin, begin + strands.BLOCK_STRANDS)
        at = None if roots is None else strands.float32(roots[part])
        block, of_radii = _between(shapes, shape_radii, own[part], around, pull, rng, at)
        n = block.shape[2]
        _cut(block, 1.0 - length_variation * rng.random(n, np.float32))
        if frizz:
            wander = frizz * lengths[own[part]] * rng.uniform(0.4, 1.6, n)
            strands.frizz(block, strands.float32(wander), rng)
        points[part] = block.transpose(2, 0, 1)
        if radius is not None:
            of_radii *= np.float32(radius) / np.maximum(of_radii[:, :1], np.float32(1e-18))
        radii[part] = of_radii * (1.0 + radius_variation * rng.uniform(-1.0, 1.0, (n, 1)))
    of_strands = {
        name: values[own]
        for name, values in guides.attributes.items()
        if len(values) == guides.n_strands
    }
    left_out = [name for name in guides.attributes if name not in of_strands]
    of_strands.setdefault(CLUMP, clump_values(own))
    return adopted(
        points,
        radii,
        source=source,
        attributes=of_strands,
        ignored=[*guides.ignored, *left_out],
    )


def _resampled(guides: Curves, k: int) -> tuple[Block, Block, Block]:
    """Points (m, k, 3), radii (m, k) and lengths (m,) of guides, even in their lengths."""
    steps = np.linalg.norm(np.diff(guides.points, axis=0), axis=1).astype(np.float64)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    first, last = guides.offsets[:-1], guides.offsets[1:] - 1
    lengths = arc[last] - arc[first]
    at = arc[first, None] + lengths[:, None] * np.linspace(0.0, 1.0, k)
    # Between strands the running length makes a step that no place of `at` is in, but for rounding.
    near = np.clip(np.searchsorted(arc, at, side="right") - 1, first[:, None], last[:, None] - 1)
    t = np.clip((at - arc[near]) / np.maximum(arc[near + 1] - arc[near], 1e-300), 0.0, 1.0)
    t = t.astype(np.float32)
    points = guides.points[near] + t[..., None] * (guides.points[near + 1] - guides.points[near])
    radii = guides.radii[near] + t * (guides.radii[near + 1] - guides.radii[near])
    return points, radii, strands.float32(lengths)


def _neighbours(guides: Curves, shapes: Block, spread_deg: float) -> NDArray[np.int64]:
    """Guides next to each guide (m, NEIGHBOURS), by their roots; itself in place of those that go
    elsewhere."""
    m = guides.n_strands
    roots = shapes[:, 0]
    if m == 1:
        return np.zeros((1, NEIGHBOURS), np.int64)
    found = np.asarray(KDTree(roots).query(roots, k=min(NEIGHBOURS + 1, m))[1])
    around = np.resize(found[:, 1:].T, (NEIGHBOURS, m)).T.astype(np.int64)
    way = shapes[:, -1] - roots
    way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-30)
    cosine = np.einsum("mc,mnc->mn", way, way[around])
    return np.where(cosine >= np.cos(np.radians(spread_deg)), around, np.arange(m)[:, None])


def _between(
    shapes: Block,
    shape_radii: Block,
    own: NDArray[np.int64],
    around: NDArray[np.int64],
    pull: Block,
    rng: np.random.Generator,
    roots: Block | None,
) -> tuple[Block, Block]:
    """A block (k, 3, b) of children of guides `own` (b,), and their radii (b, k), at roots (b, 3)
    if these are given."""
    n = len(own)
    place = rng.integers(NEIGHBOURS, size=n)
    other = (place + rng.integers(1, NEIGHBOURS, size=n)) % NEIGHBOURS
    sources = (own, around[own, place], around[own, other])
    # Uniform in the triangle: the gaps of two uniform numbers.
    cuts = np.sort(rng.random((2, n), np.float32), axis=0)
    weights = np.sort(np.stack([cuts[0], cuts[1] - cuts[0], 1.0 - cuts[1]]), axis=0)[::-1]
    if roots is not None:
        sources = (own, *around[own].T)
        weights = _weights(shapes[:, 0], np.stack(sources), roots)
    mean = sum(w[:, None, None] * shapes[i] for w, i in zip(weights, sources, strict=True))
    radii = sum(w[:, None] * shape_radii[i] for w, i in zip(weights, sources, strict=True))
    block = np.ascontiguousarray(np.transpose(mean, (1, 2, 0)))
    if roots is not None:
        block += roots.T - block[0]
    guide = np.transpose(shapes[own], (1, 2, 0))
    block += pull[:, None, :] * (guide - block)
    return block, np.asarray(radii, np.float32)


def _weights(guide_roots: Block, sources: NDArray[np.int64], roots: Block) -> Block:
    """Weights (g, b) of guides `sources` (g, b) for children at roots (b, 3), of sum 1.

    They are 1 over the squared distance, less its value at the farthest of the guides, so that a
    guide which comes into the circle or leaves it changes nothing suddenly.
    """
    square = ((guide_roots[sources] - roots) ** 2).sum(axis=2, dtype=np.float64)
    farthest = square.max(axis=0)
    # A guide at the root itself has all the weight; guides that are all as far away share it.
    tiny = 1e-12 * farthest + 1e-30
    weights = 1.0 / (square + tiny) - 1.0 / (farthest + tiny)
    # A guide that stands in place of one that goes elsewhere counts once.
    for i in range(1, len(sources)):
        weights[i, (sources[i] == sources[0])] = 0.0
    total = weights.sum(axis=0)
    alone = total <= 0.0
    weights[0, alone], total[alone] = 1.0, 1.0
    return strands.float32(weights / total)


def _cut(block: Block, ratio: Block) -> None:
    """Shorten strands to a part `ratio` (b,) of their length, in place."""
    last = len(block) - 1
    before = block.copy()
    columns = np.arange(block.shape[2])
    for j in range(1, last + 1):
        place = ratio * np.float32(j)
        near = np.minimum(place.astype(np.int32), last - 1)
        a, b = (before[near + step, :, columns].T for step in (0, 1))
        block[j] = a + (place - near) * (b - a)
