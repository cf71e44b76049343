"""Long-axis split (Improved-GS, Deng et al. 2025): two halves side by side along the longest axis, and no dice.

A primitive of scales s becomes two whose centres are 3 · .45 s_max from its own, either way along its longest
axis; that axis shrinks to 1 - .45, the others to √(1 - .45²), and opacities to .6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...scene.quaternions import rotated
from ...training.optimizer.splat_optimizer import SplatOptimizer

REACH = 3.0  # standard deviations that the distance is a part of


@dataclass(frozen=True)
class LongAxisHalves:
    """Makes the halves of a split; a ``Halves`` of ``Densification``."""

    distance: float = 0.45
    opacity: float = 0.6

    def __call__(self, optimizer: SplatOptimizer, first: int, rng: np.random.Generator) -> None:
        rows = np.arange(first, optimizer.n)
        log_scales, quats = optimizer.numpy("log_scales")[rows], optimizer.numpy("quats")[rows].astype(np.float64)
        longest = np.eye(3)[log_scales.argmax(1)]  # [R, 3] its axis, in the primitive's frame
        side = np.where(np.arange(len(rows)) < len(rows) // 2, 1.0, -1.0)[:, None]
        offset = side * REACH * self.distance * np.exp(log_scales.max(1, keepdims=True)) * rotated(longest, quats)
        optimizer.assign("means", optimizer.numpy("means")[rows] + offset, rows)
        shrunk = np.where(longest > 0, np.log(1 - self.distance), np.log(1 - self.distance**2) / 2)
        optimizer.assign("log_scales", log_scales + shrunk, rows)
        logits = optimizer.numpy("logit_opacities")[rows].astype(np.float64)
        log_opacity = np.log(self.opacity) - np.logaddexp(0, -logits)
        optimizer.assign("logit_opacities", log_opacity - np.log(-np.expm1(log_opacity)), rows)
