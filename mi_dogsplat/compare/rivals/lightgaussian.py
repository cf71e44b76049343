"""LightGaussian (Fan et al. 2024, Sec. 3.1): global significance, weighted by the volume.

    GS_i = (V_i / V_90%)^0.1 Σ o_i T_i        over all pixels that it is blended in, V the product of its scales

V_90%, the volume that 90 % are larger than (in the authors' code, which does not limit the ratio), scales all scores
alike and is left out. Pruned once, after the training in the paper, at the densified start here; then refined.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...scene.opacity import sigmoid
from ...scores.training_views import TrainingViews
from ...scores.weights import weights
from ...training.recipe import Recipe
from ...training.strategy.scheduler import PruningRule

DEVIATIONS = (
    "pruned at step 15,000 to the budget (the code prunes a trained model, by 66 %); neither distillation of SH nor "
    "quantisation; step sizes are those of 3DGS (in the code all except those of positions fall by 5 % every 400 "
    "steps)"
)


@dataclass(frozen=True)
class GlobalSignificance:
    """Σ o T times a power of the volume."""

    volume_power: float = 0.1

    def __call__(self, params: dict, views: TrainingViews, seed: int) -> np.ndarray:
        opacity = sigmoid(params["logit_opacities"].numpy().astype(np.float64))  # [N]
        log_volume = params["log_scales"].numpy().reshape(-1, 3).sum(1, dtype=np.float64)  # [N]
        transmittance = weights(params, views.cameras, views.options, mask=views.mask).transmittance
        return opacity * transmittance * np.exp(self.volume_power * log_volume)


RECIPE = Recipe(pruning=PruningRule(stop=15_500, division=(1.0,), rounds=1), score=GlobalSignificance())
