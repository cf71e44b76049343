"""Mini-Splatting (Fang and Wang 2024, Sec. 4.2): importance sampling, then what carries most of the mass.

The importance of a primitive is Σ α T over all pixels of all training views (for indoor scenes; outdoors the authors
divide by the projected area), and 0 if it has the largest weight of no pixel. At step 15,000 half of the primitives is
drawn, without replacement, with probabilities in proportion to it: unlike a threshold that leaves geometry where all
are unimportant. Then all of them begin anew (``reinitialize.py``). At step 20,000 the best are kept: 99 % of the mass
in the paper, the budget here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...scores.training_views import TrainingViews
from ...scores.weights import weights
from ...training.recipe import Recipe
from ...training.strategy.scheduler import PruningRule
from ...training.strategy.strategy import Strategy, Training
from .reinitialize import RESTARTED, Reinitialize
from .step_sizes import OPACITY_OF_2023

DEVIATIONS = (
    "no blur split and no points from depth during densification, because all methods share one start; prunes go "
    "parts of the way to the budget (the code keeps a half, and then 99 % of the mass); all SH degrees at once after "
    "the restart; indoor importance, not divided by the area, for all captures"
)

@dataclass(frozen=True)
class SummedWeight:
    """Σ α T, or 0 without a pixel of its own."""

    def __call__(self, params: dict, views: TrainingViews, seed: int) -> np.ndarray:
        found = weights(params, views.cameras, views.options, mask=views.mask)
        return np.where(found.dominates, found.total, 0)


def sampling_keys(importance: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """[N] keys; the k largest are a sample of k without replacement, with probabilities in proportion to importance.

    log of the importance plus Gumbel noise (Efraimidis and Spirakis 2006; "Gumbel top-k").
    """
    with np.errstate(divide="ignore"):
        return np.log(importance) + rng.gumbel(size=len(importance))


@dataclass
class Rounds:
    """State of ``DrawFirst``: prunes so far."""

    count: int = 0


@dataclass(frozen=True)
class DrawFirst(Strategy[Rounds]):
    """Draws in the first round; later ones take the best."""

    def new_state(self, t: Training) -> Rounds:
        return Rounds()

    def scores(self, t: Training, state: Rounds, rest: Callable[[], np.ndarray]) -> np.ndarray:
        importance = rest()
        state.count += 1
        return sampling_keys(importance, t.rng) if state.count == 1 else importance


RECIPE = Recipe(
    pruning=PruningRule(15_000, 20_000, check_every=5000, max_interval=5000, division=(0.3, 0.7), rounds=2),
    score=SummedWeight(),
    also=(DrawFirst(), Reinitialize(adam=20_000), OPACITY_OF_2023),
    refinement=RESTARTED,
)
