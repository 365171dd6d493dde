"""Trigger, record and validate on a stream of samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TriggerSettings:
    """When a block of samples counts as the start of a pulse; the thesis's figures by default."""

    block_samples: int = 64
    threshold_counts: float = 50.0
    consecutive: int = 5
    least_receivers: int = 2
    skip_last_window: bool = True  # as published: the loop over windows ends one early

    def tripped(self, blocks: FloatArray) -> NDArray[np.bool_]:
        """Which blocks trip, from samples (..., receivers, blocks, block_samples): (..., blocks)."""
        above = np.abs(blocks - blocks.mean(axis=-1, keepdims=True)) > self.threshold_counts
        windows = self.block_samples - self.consecutive + (0 if self.skip_last_window else 1)
        run = above[..., :windows]
        for shift in range(1, self.consecutive):
            run = run & above[..., shift : shift + windows]
        result: NDArray[np.bool_] = run.any(axis=-1).sum(axis=-2) >= self.least_receivers
        return result
