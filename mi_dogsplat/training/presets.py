"""Recipes by name: what ``--preset`` chooses.

``paper`` and ``released`` are the method of Wang et al. 2026 as printed and as in the authors' code, which differ;
``3dgs`` is the baseline both start from (Kerbl et al. 2023).
"""

from __future__ import annotations

import math
from dataclasses import replace

from ..scores.score import ScoreRule
from .optimizer.learning_rates import Refinement
from .recipe import ACTIVATION, Recipe
from .strategy.cut_activation import CutRule
from .strategy.densify import Densification
from .strategy.dog_control import DogRule
from .strategy.scheduler import PruningRule
from .strategy.shift_activation import ShiftRule
from .strategy.slope_activation import SlopeRule

EARLY_SHARE = 0.35  # share of the steps in which a model of "ours_early" grows

# why these numbers: docs/experiments.md
OURS = Recipe(
    densification=Densification(max_world_scale=math.inf),
    pruning=PruningRule(stop=17_500, max_interval=500, rounds=5),
    score=ScoreRule("leave-one-out", spectral_weight=0.0),
    dog=DogRule(ACTIVATION, opacity=0.05, scale=0.6),
    refinement=Refinement(15_000, gain=4.0, end_gain=0.1, means_gain=16.0, few=10_000, sh_gain=4.0),
)
OURS_SLOPES = replace(OURS, slopes=SlopeRule(ACTIVATION))
OURS_CUTS = replace(OURS_SLOPES, cuts=CutRule(ACTIVATION))
OURS_SECOND_CUTS = replace(OURS_CUTS, second_cuts=CutRule(ACTIVATION))
OURS_CURVATURES = replace(OURS_SECOND_CUTS, curvatures=SlopeRule(ACTIVATION))
OURS_SHIFTS = replace(OURS_CURVATURES, shifts=ShiftRule(ACTIVATION)).preconditioned()
RECIPES = {
    "ours": OURS,
    "ours_slopes": OURS_SLOPES,
    "ours_cuts": OURS_CUTS,
    "ours_preconditioned": OURS_CUTS.preconditioned(),
    "ours_second_cuts": OURS_SECOND_CUTS.preconditioned(),
    "ours_curvatures": OURS_CURVATURES.preconditioned(),
    "ours_shifts": OURS_SHIFTS,
    "ours_early": OURS_SHIFTS.growing(EARLY_SHARE),
    # the text: all factors below 1. Their starts, the weights, gamma and the threshold are ours: docs/training.md
    "paper": Recipe(
        pruning=PruningRule(),
        score=ScoreRule("spatio-spectral", spatial_weight=1.0, spectral_weight=1.0, gamma_f=1.0),
        dog=DogRule(opacity=0.5, scale=0.6),
    ),
    "released": Recipe(
        pruning=PruningRule(start=15_700, stop=25_200, beta=0.99, rounds=5),  # its step 15,200 only prepares
        score=ScoreRule("released"),
        dog=DogRule(start=25_200, opacity=0.5, scale=1.6, control=False),
        reference_steps=40_000,
    ),
    "3dgs": Recipe(),
}
