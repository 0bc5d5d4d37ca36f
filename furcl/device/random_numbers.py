"""The kernels' random numbers in numpy: what the self-test and tests compare devices with.

Both generators are functions of (seed, pixel, sample, dimension) alone, four numbers at a time; the
kernels' own are in kernels/include/core/rng.clh and sobol.clh.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

PHILOX_KEY = 0x66757263
KEYS_OF_DIMENSIONS = (0x85EBCA6B, 0xC2B2AE35, 0x27D4EB2F, 0x165667B1)

# Widths of neighbouring groups of bits, and the lower one of each two.
BIT_SWAPS = ((16, 0xFFFF), (8, 0xFF00FF), (4, 0xF0F0F0F), (2, 0x33333333), (1, 0x55555555))

# Degree, inner coefficients and first direction numbers of the second to fourth dimension of Joe
# and Kuo's table new-joe-kuo-6.21201; the first dimension is the radical inverse.
JOE_KUO = ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)))


def philox4x32(counter: np.ndarray, key: tuple[int, int]) -> np.ndarray:
    """Philox4x32-10 in numpy.

    Parameters
    ----------
    counter : (n, 4) integer    counters, each word below 2^32
    key : two integers          below 2^32

    Returns
    -------
    (n, 4) uint32

    Source: Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3".
    """
    c = [counter[:, i].astype(np.uint64) for i in range(4)]
    k0, k1 = key
    mask = np.uint64(0xFFFFFFFF)
    for _ in range(10):
        p0, p1 = np.uint64(0xD2511F53) * c[0], np.uint64(0xCD9E8D57) * c[2]
        high0, high1 = p0 >> np.uint64(32), p1 >> np.uint64(32)
        c = [high1 ^ c[1] ^ np.uint64(k0), p1 & mask, high0 ^ c[3] ^ np.uint64(k1), p0 & mask]
        k0, k1 = (k0 + 0x9E3779B9) & 0xFFFFFFFF, (k1 + 0xBB67AE85) & 0xFFFFFFFF
    return np.stack(c, axis=1).astype(np.uint32)


def independent_bits(seed: int, pixel: ArrayLike, sample: ArrayLike, dimension: int) -> np.ndarray:
    """Words of independent numbers.

    Parameters
    ----------
    seed, dimension : integers              below 2^32
    pixel, sample : (n,) integer            below 2^32; broadcast against each other

    Returns
    -------
    (n, 4) uint32       a number is the upper 24 bits over 2^24
    """
    pixel, sample = np.broadcast_arrays(np.atleast_1d(pixel), sample)
    counter = np.stack([pixel, sample, np.full_like(pixel, dimension), 0 * pixel], axis=1)
    return philox4x32(counter, (seed, PHILOX_KEY))


def sobol_directions() -> NDArray[np.uint32]:
    """Direction numbers of four dimensions, (4, 32): the word of a point's bits is the exclusive or
    of those of the bits of its index.

    Source: Joe and Kuo 2008, "Constructing Sobol sequences with better two-dimensional
    projections".
    """
    directions = np.zeros((4, 32), np.uint32)
    directions[0] = [1 << (31 - i) for i in range(32)]
    for words, (degree, inner, first) in zip(directions[1:], JOE_KUO, strict=True):
        v = [m << (31 - i) for i, m in enumerate(first)]
        for i in range(degree, 32):
            word = v[i - degree] ^ (v[i - degree] >> degree)
            for k in range(1, degree):
                if inner >> (degree - 1 - k) & 1:
                    word ^= v[i - k]
            v.append(word)
        words[:] = v
    return directions


def sobol_points(index: ArrayLike) -> NDArray[np.uint32]:
    """Sobol points of indices, (n,) integers below 2^32: (n, 4) uint32, 2^32 times the point."""
    index = np.atleast_1d(np.asarray(index, np.uint32))
    words = sobol_directions()
    point = np.zeros((len(index), 4), np.uint32)
    for bit in range(int(index.max(initial=0)).bit_length()):
        chosen = (index >> np.uint32(bit) & np.uint32(1))[:, None]
        point ^= chosen * words[:, bit]
    return point


def reversed_bits(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """The bits of each word in reverse order."""
    for width, lower in BIT_SWAPS:
        shift, mask = np.uint32(width), np.uint32(lower)
        x = (x >> shift & mask) | (x & mask) << shift
    return x


def hashed_bits(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Hash of words.

    Source: Wellons 2018, "Prospecting for hash functions", lowbias32.
    """
    x = (x ^ x >> np.uint32(16)) * np.uint32(0x7FEB352D)
    x = (x ^ x >> np.uint32(15)) * np.uint32(0x846CA68B)
    return x ^ x >> np.uint32(16)


def scrambled(x: NDArray[np.uint32], key: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Nested uniform scrambling: every bit is flipped or not by a hash of the bits above it.

    Parameters
    ----------
    x, key : (n,) uint32    key: a word for every scrambling, uniform

    Source: Laine and Karras 2011, "Stratified sampling for stochastic transparency", with constants
    of Vegdahl 2021, "Building a better LK hash".
    """
    x = reversed_bits(x)
    x = (x ^ x * np.uint32(0x3D20ADEA)) + key
    x = x * (key >> np.uint32(16) | np.uint32(1))
    x = x ^ x * np.uint32(0x05526C56)
    return reversed_bits(x ^ x * np.uint32(0x53A22864))


def reordered(sample: NDArray[np.uint32], key: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Samples with places changed within eights, by a product with bits of the key.

    Nested scrambling alone keeps pairs of samples together, on opposite sides in all dimensions.
    """
    return sample ^ (sample * (key & np.uint32(6)) & np.uint32(7))


def pixel_hash(seed: int, pixel: NDArray[np.uint32], dimension: int) -> NDArray[np.uint32]:
    """The word from which the keys of a pixel and a dimension are made."""
    start = np.array([seed ^ PHILOX_KEY], np.uint32)
    first = hashed_bits(hashed_bits(start) + np.uint32(dimension))
    return hashed_bits(pixel + first) ^ hashed_bits(first + np.uint32(0x9E3779B9))


def sobol_bits(seed: int, pixel: ArrayLike, sample: ArrayLike, dimension: int) -> np.ndarray:
    """Words of Owen-scrambled Sobol numbers; parameters and result as for `independent_bits`.

    Source: Burley 2020, "Practical hash-based Owen scrambling".
    """
    pixel, sample = np.broadcast_arrays(np.atleast_1d(pixel), sample)
    base = pixel_hash(seed, pixel.astype(np.uint32), dimension)

    def key(odd: int) -> NDArray[np.uint32]:
        word = base * np.uint32(odd)
        return word ^ word >> np.uint32(16)

    order = reordered(sample.astype(np.uint32), base)
    points = sobol_points(scrambled(order, base))
    columns = zip(points.T, KEYS_OF_DIMENSIONS, strict=True)
    return np.stack([scrambled(x, key(odd)) for x, odd in columns], axis=1)
