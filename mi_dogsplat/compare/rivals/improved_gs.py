"""Improved-GS (Deng et al. 2025, arXiv 2508.12313): splits along the longest axis where photographs have edges.

At each refinement the model may have √p of the budget, p the part of the way to step 14,500 that is done. Those that
grow are drawn, in proportion to the mean over 10 random views of Σ e α T, divided by its mean over what the view shows;
e are the edges of the photograph. After that step the gradient itself takes the place of the edges. All are split
(``long_axis.py``). Opacities are reset to .05; what is below .02 goes at step 300, a fifth with the
smallest opacities 300 steps after the first two resets, while it densifies ("recovery-aware"). Position steps fall from
a quarter of the recipe's to 1.25 times them, those of SH are double.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...render.picture import photograph
from ...scores.weights import weights
from ...training.events import Dropped, Event
from ...training.milestones import scaled_milestone
from ...training.recipe import Recipe
from ...training.strategy.densify import Choice, Densification
from ...training.strategy.densify_stats import DensifyStats
from ...training.strategy.prune import keep_best
from ...training.strategy.strategy import Strategy, Training
from .growth import START_SHARE, best, opacities, progress
from .long_axis import LongAxisHalves
from .mini_splatting import sampling_keys
from .taming import edges, from_0_to_1

DEVIATIONS_OF_BOTH = (
    "gradients of the centres are sums over pixels (the code sums their magnitudes), and have no threshold, so only "
    "the budget limits growth; a densification step may at once refill the room of primitives that it removes; edges "
    "of 10 random views (the code takes views in turn, and all of them at steps 3,400 and 6,400); no steps of several "
    "views after step 20,000; a start of at most half the budget"
)  # of this and of GNS
DEVIATIONS = f"{DEVIATIONS_OF_BOTH}; written from the code of GNS, which is based on it"
VIEWS = 10
FULL = (14_500 - 500) / (14_900 - 500)  # progress at which there is room for all, and after which the gradient decides


def edge_scores(t: Training) -> np.ndarray:
    """[N] how much of the photographs' edges a primitive covers, the mean over some views."""
    total = np.zeros(t.optimizer.n)
    chosen = t.rng.permutation(len(t.photographs))[:VIEWS]
    for k in chosen:
        view, camera = t.photographs.views[int(k)], t.photographs.cameras[int(k)]
        photographed = edges(photograph(view, t.photographs.background))
        mask = t.photographs.shown_mask(int(k))
        e = from_0_to_1(photographed, mask)
        found = weights(t.optimizer.params, [camera], t.options, [e], [mask].__getitem__)
        if (found.weighted > 0).any():
            total += found.weighted / found.weighted[found.weighted > 0].mean() / len(chosen)
    return total


@dataclass(frozen=True)
class EdgeGrowth:
    """Who grows: a draw, along a square root, to ``over`` times the budget."""

    over: float = 1.0

    def __call__(self, t: Training, rule: Densification, stats: DensifyStats) -> Choice:
        done, gradient = progress(t, rule), stats.mean_gradient().astype(np.float64)
        opacity = opacities(t)
        remove = (opacity < rule.min_opacity) & (done < 1)
        if remove.all():
            remove[np.argmax(opacity)] = False
        scores = gradient if done > FULL else edge_scores(t)
        most = min(self.over * int(t.target), rule.max_primitives or np.inf)
        room = round(min(1.0, done / FULL) ** 0.5 * most) - int(np.sum(~remove))
        grow = best(sampling_keys(scores, t.rng), ~remove & (scores > 0), room)
        return Choice(grow, np.zeros(len(grow), bool), remove)


@dataclass(frozen=True)
class RecoveryAware(Strategy[None]):
    """Removes by opacity, once early and where opacities have not come back after a reset."""

    first: int = 300
    min_opacity: float = 0.02
    after_resets: tuple[int, ...] = (3300, 6300)  # a tenth of the steps between two resets later
    share: float = 0.2

    def scaled(self, factor: float) -> RecoveryAware:
        density = DENSIFICATION.scaled(factor)
        again = (round(step * density.reset_every / DENSIFICATION.reset_every) for step in self.after_resets)
        inside = tuple(step for step in again if step < density.stop)  # later nothing grows again in its place
        return replace(self, first=scaled_milestone(self.first, factor), after_resets=inside)

    def due(self, t: Training, state: None) -> bool:
        return t.step_count in (self.first, *self.after_resets)

    def after_step(self, t: Training, state: None) -> list[Event]:
        if not self.due(t, state):
            return []
        n, logits = t.optimizer.n, t.optimizer.numpy("logit_opacities")
        limit = np.log(self.min_opacity / (1 - self.min_opacity))
        left = int(np.sum(logits >= limit)) if t.step_count == self.first else n - int(self.share * n)
        keep_best(t.optimizer, logits, max(1, left))
        return [Dropped(n - t.optimizer.n, "faint primitives")] if t.optimizer.n < n else []


@dataclass(frozen=True)
class GentleSteps(Strategy[None]):
    """Position steps from 4e-5 to 2e-6 times the extent, those of SH 1/20 of 5e-3."""

    def before_step(self, t: Training, state: None) -> None:
        rates = t.optimizer.learning_rates
        part = min(t.step_count / max(rates.total_steps, 1), 1.0)
        t.optimizer.rate_factors |= {"means": 0.25 * (1.25 / 0.25) ** part, "sh_rest": 2.0}


DENSIFICATION = Densification(reset_opacity_to=0.05, growth=EdgeGrowth(), halves=LongAxisHalves())
RECIPE = Recipe(densification=DENSIFICATION, also=(RecoveryAware(), GentleSteps()), start_share=START_SHARE)
