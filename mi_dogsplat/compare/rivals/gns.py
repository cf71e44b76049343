"""GNS, "gradient of natural selection" (2025, arXiv 2511.16980): all opacities are pulled down alike.

The base is Improved-GS, grown to three times the budget. From step 15,000 on every 50th step has in its loss

    λ (mean (l + 20) / max(.05, 1 - o))²      l the logits of the opacities o, in the first 1,000 steps
    3 λ (mean l + 20)²                        after that

whose gradient by the logits is nearly the same for all: what the photographs need pulls back, the others fade, and go
below .001. Step sizes of opacities are four times the recipe's until 1,000 steps after the budget is met. λ begins at
2e-4; every 100 steps it grows or shrinks by a fifth if the opacity at the rank of the budget is a tenth above or below
its way from .8 of what it was to 0 at step 22,000. Where 1.05 times the budget is left, and at step 23,000, those that
stay are drawn in proportion to opacity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...scores.score import ScoreRule
from ...training.events import Dropped, Event
from ...training.milestones import scaled_milestone
from ...training.recipe import Recipe
from ...training.strategy.prune import keep_best
from ...training.strategy.scheduler import PruningRule
from ...training.strategy.strategy import Seen, Strategy, Training
from .growth import START_SHARE, opacities
from .improved_gs import DENSIFICATION, DEVIATIONS_OF_BOTH, EdgeGrowth, GentleSteps, RecoveryAware
from .mini_splatting import sampling_keys

DEVIATIONS = DEVIATIONS_OF_BOTH
FROM, TO = 15_000, 23_000  # steps
FAINT = 0.001  # opacity below which primitives go


@dataclass
class Pressure:
    """State of ``NaturalSelection``: λ, the opacity that its way began at, and the step at which the budget was met."""

    weight: float = 2e-4
    began: float = 0.0
    met: int = -1


@dataclass(frozen=True)
class NaturalSelection(Strategy[Pressure]):
    """Presses from step ``start`` until the budget is met, at step ``stop`` at the latest."""

    start: int = FROM
    stop: int = TO
    every: int = 50
    gentle: int = 1000  # steps of the first kind, and of larger step sizes after the budget is met
    rate_factor: float = 4.0

    def scaled(self, factor: float) -> NaturalSelection:
        names = ("start", "stop", "every", "gentle")
        return replace(self, **{name: scaled_milestone(getattr(self, name), factor) for name in names})

    def new_state(self, t: Training) -> Pressure:
        return Pressure()

    def presses(self, t: Training, state: Pressure) -> bool:
        return self.start <= t.step_count < self.stop and state.met < 0

    def before_step(self, t: Training, state: Pressure) -> None:
        large = self.presses(t, state) or 0 <= state.met <= t.step_count < state.met + self.gentle
        t.optimizer.rate_factors["logit_opacities"] = self.rate_factor if large else 1.0
        if self._due_now(t, state):
            self._steer(t, state)

    def after_backward(self, t: Training, state: Pressure, seen: Seen) -> None:
        """The gradient of the term, every so many steps."""
        if not self._due_now(t, state):
            return
        logits: Any = t.optimizer.params["logit_opacities"]
        held, weight = dr.detach(logits), dr.opaque(mi.Float, 2 * state.weight / t.optimizer.n)
        dr.set_grad(logits, dr.grad(logits) + weight * pull(held, t.step_count < self.start + self.gentle))

    def _due_now(self, t: Training, state: Pressure) -> bool:
        return self.presses(t, state) and (t.step_count - self.start) % self.every == 0

    def _steer(self, t: Training, state: Pressure) -> None:
        rank = np.sort(opacities(t))[max(0, t.optimizer.n - int(t.target))]
        if state.began == 0:
            state.began = 0.8 * float(rank)
        elif (t.step_count - self.start) % (2 * self.every) == 0:
            way = (t.step_count - self.start) / max(self.stop - self.start - self.gentle, 1)
            goal = max(0.0, 1 - way) * state.began
            state.weight *= 0.8 if rank < 0.9 * goal else 1.2 if rank > 1.1 * goal else 1.0

    def due(self, t: Training, state: Pressure) -> bool:
        due = t.step_count % self.every == 0 or t.step_count == self.stop  # which need not be a multiple
        return due and self.start <= t.step_count <= self.stop and state.met < 0

    def after_step(self, t: Training, state: Pressure) -> list[Event]:
        """Remove what has faded; draw, where little more than the budget is left."""
        if not self.due(t, state):
            return []
        n, opacity = t.optimizer.n, opacities(t)
        left = int(np.sum(opacity >= FAINT)) if t.step_count >= self.start + self.gentle else n
        if left < 1.05 * int(t.target) or t.step_count >= self.stop:
            state.met = t.step_count
            keep_best(t.optimizer, sampling_keys(opacity, t.rng), int(t.target))
        elif left < n:
            keep_best(t.optimizer, opacity, left)
        return [Dropped(n - t.optimizer.n, "by opacity pressure")] if t.optimizer.n < n else []


def pull(logits: Any, gentle: bool) -> Any:
    """[N] half of N times the gradient of the squared mean by the logits, without λ."""
    if not gentle:
        return 3 * (dr.mean(logits) + 20) + dr.zeros(mi.Float, dr.width(logits))
    opacity = dr.rcp(1 + dr.exp(-logits))
    rest = 1 - opacity
    shown = dr.maximum(rest, 0.05)
    slope = dr.rcp(shown) + dr.select(rest > 0.05, (logits + 20) * opacity / shown, 0)
    return dr.mean((logits + 20) / shown) * slope


END = PruningRule(TO, TO, division=(1.0,), rounds=1)  # where the pressure has not met the budget
RECIPE = Recipe(
    densification=replace(DENSIFICATION, growth=EdgeGrowth(over=3.0)),
    pruning=END,
    score=ScoreRule("opacity"),
    also=(RecoveryAware(), GentleSteps(), NaturalSelection()),
    start_share=START_SHARE,
)
