"""What strands of a lock share: the guide that they are drawn to and the way they wave."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.groom.grow.strands import Block, clump

Rng = np.random.Generator


class Clumps:
    """Guides, their lengths, and the guide that each strand is drawn to.

    Attributes
    ----------
    guides : (m, k, 3)           points of the guides
    length : (m,)                their lengths
    idx : (n,)                   the guide of each strand
    """

    def __init__(self, block: Block, length: Block, idx: NDArray[np.int64]) -> None:
        self.guides = np.ascontiguousarray(block.transpose(2, 0, 1))
        self.length = length
        self.idx = idx

    def draw(self, block: Block, own: slice, length: Block, weight: Block) -> None:
        """Draw the strands `own`, of the given lengths (b,), to their guides, in place."""
        idx = self.idx[own]
        clump(block, self.guides, idx, length / self.length[idx], weight)


@dataclass(frozen=True)
class Waves:
    """Random variation of waves: direction (m, 3), phase [rad], relative rate and depth (m,)."""

    side: Block
    phase: Block
    rate: Block
    depth: Block

    @staticmethod
    def random(n: int, rng: Rng) -> "Waves":
        """Waves of n independent strands."""
        return Waves(
            rng.standard_normal((n, 3), dtype=np.float32),
            np.float32(2.0 * np.pi) * rng.random(n, dtype=np.float32),
            0.85 + np.float32(0.3) * rng.random(n, dtype=np.float32),
            0.6 + np.float32(0.8) * rng.random(n, dtype=np.float32),
        )

    def children(self, parent_idx: NDArray, spread: float, rng: Rng) -> "Waves":
        """Waves of strands that follow a parent: `spread` 0 the same, 1 nearly independent."""
        n = len(parent_idx)

        def normal(*shape):
            return np.float32(spread) * rng.standard_normal(shape, dtype=np.float32)

        return Waves(
            self.side[parent_idx] + normal(n, 3),
            self.phase[parent_idx] + np.float32(1.5) * normal(n),
            self.rate[parent_idx] * (1.0 + np.float32(0.1) * normal(n)),
            self.depth[parent_idx] * np.exp(np.float32(0.3) * normal(n)),
        )
