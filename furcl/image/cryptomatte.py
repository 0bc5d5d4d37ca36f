"""Cryptomatte: which objects a pixel shows and how much of it each covers, as channels.

Source: Friedman and Jones, Cryptomatte specification 1.2.0 (2015 to 2018).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError


@dataclass(frozen=True, eq=False)
class Cryptomatte:
    """The channels of a matte and the header attributes that name it.

    Attributes
    ----------
    channels : dict         NAME00.R, NAME00.G, ...: (H, W) float32, id and coverage in turns, the
                            largest coverage first
    attributes : dict       cryptomatte/KEY/name, hash, conversion and manifest
    """

    channels: dict[str, NDArray[np.float32]]
    attributes: dict[str, str]

    @staticmethod
    def of(
        name: str,
        names: Mapping[int, str],
        ids: NDArray[np.int64],
        counts: NDArray[np.uint32],
        samples: NDArray[np.uint32],
        n_ranks: int,
    ) -> Cryptomatte:
        """The matte of ids with their numbers of samples.

        Parameters
        ----------
        name : str                  of the matte, such as CryptoObject
        names : dict                id -> name of what it is
        ids : (H, W, n)             -1 for none
        counts : (H, W, n)          samples of each
        samples : (H, W)            of the pixel
        n_ranks : int               ids that are kept, an even number

        Raises
        ------
        ImageError      the package mmh3 is missing
        """
        signed = np.where(ids >= 0, counts, 0).astype(np.int64)
        order = np.argsort(-signed, axis=2, kind="stable")[..., :n_ranks]
        ids, signed = np.take_along_axis(ids, order, 2), np.take_along_axis(signed, order, 2)
        hashes = {i: hash_bits(text) for i, text in names.items()}
        known = np.array(sorted(hashes), np.int64)
        as_floats = np.array([hashes[int(i)] for i in known], np.uint32).view(np.float32)
        with np.errstate(invalid="ignore", divide="ignore"):
            coverage = np.nan_to_num(signed / samples[..., None]).astype(np.float32)
        floats = np.zeros(ids.shape, np.float32)
        there = signed > 0
        floats[there] = as_floats[np.searchsorted(known, ids[there])]
        channels = {}
        for rank in range(n_ranks):
            level, (of_id, of_coverage) = rank // 2, ("RG", "BA")[rank % 2]
            channels[f"{name}{level:02}.{of_id}"] = floats[..., rank]
            channels[f"{name}{level:02}.{of_coverage}"] = coverage[..., rank]
        key = f"cryptomatte/{hash_bits(name, plain=True):08x}"[: len("cryptomatte/") + 7]
        manifest = {text: f"{hashes[i]:08x}" for i, text in names.items()}
        attributes = {
            f"{key}/name": name,
            f"{key}/hash": "MurmurHash3_32",
            f"{key}/conversion": "uint32_to_float32",
            f"{key}/manifest": json.dumps(manifest, separators=(",", ":")),
        }
        return Cryptomatte(channels, attributes)


def hash_bits(name: str, plain: bool = False) -> int:
    """The id of a name, 32 bits: MurmurHash3, and unless `plain` never those of a float32 that is
    no number, infinite or denormal: the lowest bit of such an exponent is turned over.

    Raises
    ------
    ImageError      the package mmh3 is missing
    """
    try:
        import mmh3
    except ImportError:
        raise ImageError(
            "cryptomatte needs the package mmh3; install it with pip install 'furcl[cryptomatte]'"
        ) from None
    bits = mmh3.hash(name.encode(), 0, signed=False)
    return bits ^ (1 << 23) if not plain and (bits >> 23) & 255 in (0, 255) else bits
