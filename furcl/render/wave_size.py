"""How many paths are traced together: asked for, remembered, or measured as a render begins."""

from __future__ import annotations

import hashlib
import json
import logging
import math
from pathlib import Path

from furcl.device import layout
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.errors import ResourceError
from furcl.files import write_cache
from furcl.paths import cache_folder

log = logging.getLogger(__name__)

# Sizes that are measured, the one first that serves while nothing is known. On a CPU the state
# should stay in the caches, and PoCL compiles kernels again for grids of 2^16 work-items and more.
CANDIDATES_CPU = (1 << 15, (1 << 16) - 64)
CANDIDATES_GPU = (1 << 20, 1 << 22, 1 << 18)

# Times that each is measured; the fastest counts, so that a moment's other load does not.
ROUNDS = 2

# A size other than the first must be faster by this factor.
WORTHWHILE = 1.02

# Path state and queues may take this share of the device's memory.
MEMORY_SHARE = 0.25


def bytes_per_path(features: Features) -> int:
    """Device memory of a slot: its planes and its entries in the five queues [bytes]."""
    return 4 * (len(layout.planes(features)) + 5)


class WaveSize:
    """The size of the next wave.

    Pictures do not depend on the size of waves, so the candidates are measured on a render's own
    first waves, each over whole samples of the picture, and the fastest one is used from then on
    and remembered for the device, its driver and the features.

    Parameters
    ----------
    device : Device
    features : Features
    n_pixels : int          of the picture
    asked : int or None     the size to use, whatever is faster [paths]

    Attributes
    ----------
    capacity : int          slots that waves may need
    paths : int             paths of the next wave, at most capacity
    origin : str            "asked for", "cache", "memory" (nothing larger fits), "probe", or "first
                            guess" while a probe is not over

    Raises
    ------
    ResourceError       if asked is below 1
    """

    def __init__(
        self, device: Device, features: Features, n_pixels: int, asked: int | None = None
    ) -> None:
        self._path = cache_path(device, features)
        self._untried: list[int] = []
        self._seconds: dict[int, float] = {}
        self._in_block, self._block_seconds = 0, 0.0
        # The first wave meets cold caches and is not measured.
        self._warm = False
        if asked is not None:
            if asked < 1:
                raise ResourceError(f"wave size {asked}: at least one path is traced at a time")
            self.capacity, self.origin = asked, "asked for"
        else:
            candidates = affordable(device, features)
            remembered = load(self._path, candidates)
            if remembered:
                self.capacity, self.origin = remembered, "cache"
            elif len(candidates) == 1:
                self.capacity, self.origin = candidates[0], "memory"
            else:
                self.capacity, self.origin = max(candidates), "first guess"
                self._untried = list(candidates) * ROUNDS
        self.paths = self._untried[0] if self._untried else self.capacity
        # Every candidate traces as many whole samples as fill the largest wave.
        self._block = -(-self.capacity // n_pixels) * n_pixels

    @property
    def probing(self) -> bool:
        """Whether sizes are being measured."""
        return bool(self._untried)

    def limit(self) -> int:
        """The most paths that the next wave may have."""
        return min(self.paths, self._block - self._in_block) if self.probing else self.paths

    def record(self, n_paths: int, seconds: float) -> None:
        """Take note of a wave's time, and of the choice when all candidates have had theirs."""
        if not self.probing:
            return
        if not self._warm:
            self._warm = True
            return
        self._block_seconds += seconds
        self._in_block += n_paths
        if self._in_block < self._block:
            return
        size = self._untried.pop(0)
        self._seconds[size] = min(self._block_seconds, self._seconds.get(size, math.inf))
        self._in_block, self._block_seconds = 0, 0.0
        if self._untried:
            self.paths = self._untried[0]
            return
        self.paths, self.origin = fastest(self._seconds), "probe"
        log.info("wave size %d: %s", self.paths, self._report())
        store(self._path, self.paths)

    def _report(self) -> str:
        return ", ".join(
            f"{size} paths {self._block / seconds / 1e6:.3f} M/s"
            for size, seconds in self._seconds.items()
        )


def affordable(device: Device, features: Features) -> tuple[int, ...]:
    """The candidates that fit the device's memory; else the largest power of two that does."""
    most = MEMORY_SHARE * device.cl_device.global_mem_size / bytes_per_path(features)
    most = int(min(most, device.max_allocation_bytes / (4 * len(layout.planes(features)))))
    candidates = CANDIDATES_CPU if device.is_cpu else CANDIDATES_GPU
    return tuple(size for size in candidates if size <= most) or (
        1 << max(most.bit_length() - 1, 0),
    )


def fastest(seconds: dict[int, float]) -> int:
    """The size with the least time; the first one unless that is WORTHWHILE times slower."""
    first, best = next(iter(seconds)), min(seconds, key=lambda size: seconds[size])
    return best if seconds[first] > WORTHWHILE * seconds[best] else first


def cache_path(device: Device, features: Features) -> Path:
    """The file that remembers the size for a device, its driver and features."""
    parts = (device.name, device.platform, device.driver_version, str(features))
    digest = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]
    return cache_folder() / "waves" / f"{digest}.json"


def load(path: Path, candidates: tuple[int, ...]) -> int | None:
    """The size in a file; None if there is no file or it holds none of the candidates."""
    try:
        found = json.loads(path.read_text())["paths"]
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        log.warning("%s: damaged cache file (%r); measuring wave sizes again", path, error)
        return None
    if found not in candidates:
        log.info("%s: %r is no candidate here; measuring wave sizes again", path, found)
        return None
    return int(found)


def store(path: Path, paths: int) -> None:
    """Write a file; see furcl.files.write_cache."""
    text = json.dumps({"paths": paths}) + "\n"
    write_cache(path, lambda file: file.write_text(text))
