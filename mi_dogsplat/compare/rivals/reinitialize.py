"""Mini-Splatting's new beginning after its first simplification: points stay, everything else is as at a start.

Fang and Wang 2024 and their code. Positions and base colours stay; shapes, opacities and view dependence are those of
a point cloud, and the optimizer is new. From then on position steps are those of step 5,000 at step 15,000, so
100^(1/3) = 4.6 times the recipe's to the end (``RESTARTED``). After the second simplification the optimizer is new
again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...scene.sh_basis import C0
from ...training.initialize import splats_from_points
from ...training.milestones import scaled_milestone
from ...training.optimizer.learning_rates import Refinement
from ...training.optimizer.splat_optimizer import SplatOptimizer
from ...training.strategy.strategy import Strategy, Training

FIRST, AGAIN = 15_000, 5000  # step at which the position schedule goes back, and to where
RESTARTED = Refinement(FIRST, gain=1.0, end_gain=1.0, means_gain=100 ** ((FIRST - AGAIN) / 30_000))


def reinitialize(optimizer: SplatOptimizer) -> None:
    """Make of the model a point cloud of its centres and base colours, and begin anew."""
    splats = splats_from_points(optimizer.numpy("means"), optimizer.numpy("sh_dc") * C0 + 0.5, optimizer.sh_degree)
    for name in ("log_scales", "quats", "logit_opacities"):
        optimizer.assign(name, getattr(splats, name))
    for name in optimizer.bands:
        optimizer.assign(name, np.zeros(()))
    optimizer.restart()


@dataclass(frozen=True)
class Reinitialize(Strategy[None]):
    """``reinitialize`` after step ``points``, a new optimizer after step ``adam``: after the prunes of these steps."""

    points: int = FIRST
    adam: int | None = None

    def scaled(self, factor: float) -> Reinitialize:
        adam = None if self.adam is None else scaled_milestone(self.adam, factor)
        return replace(self, points=scaled_milestone(self.points, factor), adam=adam)

    def before_step(self, t: Training, state: None) -> None:
        if t.step_count == self.points:
            reinitialize(t.optimizer)
        elif t.step_count == self.adam:
            t.optimizer.restart()
