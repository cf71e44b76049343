"""MaskGaussian (Liu et al. 2025): every primitive exists with a probability that is learned.

In each training step a primitive is there or not, m in {0, 1}, drawn with the probability sigmoid(l) (Gumbel-softmax of
two classes, of whose scores l is the difference; straight through, temperature 1):

    C = Σ c m α T,  T <- T (1 - m α),  loss + 5e-4 (mean m)²

What is not drawn is not blended and its own parameters have no gradient, but m has: it learns what it would contribute.
That derivative is exact here (``walks/score.py`` with a share). Masks are learned from the first step on, while it
densifies, too; the scores of the two classes start at 10 and 1, so l at 9. Those that ten draws do not show go at each
refinement, and every 1,000 steps after densification. At step 25,000 those with the least probability go, down to the
budget, and all others exist from then on. In a run of another length the step size of the scores changes inversely:
they come as far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.arrays import detached
from ...engine.device_camera import DeviceCamera
from ...engine.options import RasterOptions
from ...engine.parameters import device_array
from ...engine.view import prepare
from ...engine.walks.score import Sums, composite_score
from ...scores.score import ScoreRule
from ...training.events import Event
from ...training.milestones import scaled_milestone
from ...training.recipe import Recipe
from ...training.strategy.densify import Densification
from ...training.strategy.prune import keep_best
from ...training.strategy.scheduler import PruningRule
from ...training.strategy.strategy import Seen, Strategy, Training
from .step_sizes import OPACITY_OF_2023

DEVIATIONS = (
    "the number is given: at step 25,000 masks end, and the model is pruned to the budget (the code learns masks to "
    "the end, and the number results from them); step sizes of the masks are those of 30,000 steps"
)
TO = 25_000  # step
MASK = "mask_logits"
START_LOGIT = 9.0
RATE = 0.02  # of the difference of two scores that learn at 0.01 each
WEIGHT = 5e-4  # of the squared mean
DRAWS = 10
PROBABILITY, DRAWN = "mask_probability", "mask_drawn"  # of a step, with its noise
ABSENT = -30.0  # logit of an opacity that no pixel shows
SUMS = Sums(removal=True, energy=False, probes=1)


def by_share(params: dict, camera: DeviceCamera, options: RasterOptions, share: Any, image: list, adjoint: list) -> Any:
    """[N] derivatives of a loss by m, at m = ``share``.

    Args:
        params: as in ``rasterize``, with the opacities of primitives that are there.
        share: [N] m.
        image: 3 planes of the view with these m, background included.
        adjoint: of the planes.
    """
    return composite_score(prepare(params, camera, options, SUMS.blocks), SUMS, image, adjoint, share)[0]


@dataclass(frozen=True)
class Absent(Event):
    """Primitives that left because no draw showed them."""

    kind, words = "absent", "{count} primitives absent in {draws} draws"
    count: int
    draws: int


@dataclass(frozen=True)
class MaskGaussian(Strategy[None]):
    """Draws masks from step ``start`` to the prune, at step ``stop``."""

    start: int = 0
    stop: int = TO
    sweep_every: int = 1000  # steps
    refine_every: int = Densification.every  # steps
    densified: int = Densification.stop  # step until which each refinement sweeps

    def scaled(self, factor: float) -> MaskGaussian:
        start, stop, sweep_every = (scaled_milestone(s, factor) for s in (self.start, self.stop, self.sweep_every))
        density = Densification().scaled(factor)
        return MaskGaussian(start, stop, sweep_every, density.every, density.stop)

    def params(self, t: Training, state: None, params: dict) -> dict:
        """Those that are drawn; the others cannot be seen."""
        if not self.start <= t.step_count < self.stop:
            return params
        if MASK not in t.optimizer.learned:
            t.optimizer.learn(MASK, np.full(t.optimizer.n, START_LOGIT), RATE * 30_000 / t.steps)
            params = t.optimizer.params
        noise = device_array(t.rng.logistic(size=t.optimizer.n))
        probability = dr.rcp(1 + dr.exp(-dr.detach(params[MASK]) - noise))
        drawn: Any = dr.select(probability > 0.5, mi.Float(1), mi.Float(0))
        seen = {"logit_opacities": dr.select(drawn > 0, params["logit_opacities"], ABSENT)}
        return params | seen | {PROBABILITY: probability, DRAWN: drawn}

    def after_backward(self, t: Training, state: None, seen: Seen) -> None:
        """Derivative by the masks, straight through the draw."""
        if DRAWN not in seen.params:
            return
        drawn, probability = seen.params[DRAWN], seen.params[PROBABILITY]
        params = dr.detach(t.optimizer.params)
        share, image, adjoint = (detached(values) for values in (drawn, seen.planes, seen.gradient))
        by_m = mi.Float(by_share(params, seen.camera, t.options, share, image, adjoint))
        by_m += dr.mean(drawn) * (2 * WEIGHT / t.optimizer.n)
        mask = t.optimizer.params[MASK]
        dr.set_grad(mask, dr.grad(mask) + by_m * probability * (1 - probability))

    def after_step(self, t: Training, state: None) -> list[Event]:
        """Sweep out what is hardly ever drawn; the last time just before the prune."""
        if MASK not in t.optimizer.learned or t.step_count > self.stop:
            return []
        every = min(self.refine_every, self.sweep_every) if t.step_count < self.densified else self.sweep_every
        if t.step_count % every:
            return []
        n = t.optimizer.n
        absent = t.rng.logistic(size=(DRAWS, n)).max(0) < -t.optimizer.numpy(MASK)
        keep_best(t.optimizer, -absent.astype(float), max(int(np.sum(~absent)), int(t.target)))
        return [Absent(n - t.optimizer.n, DRAWS)] if t.optimizer.n < n else []

    def scores(self, t: Training, state: None, rest: Callable[[], np.ndarray]) -> np.ndarray:
        """The masks', which are not needed any more; the recipe's where no step came before the prune."""
        if MASK not in t.optimizer.learned:
            return rest()
        result = t.optimizer.numpy(MASK)
        t.optimizer.forget(MASK)
        return result


RECIPE = Recipe(
    pruning=PruningRule(TO, TO, division=(1.0,), rounds=1),
    score=ScoreRule("opacity"),
    also=(MaskGaussian(), OPACITY_OF_2023),
)
