"""MaskGaussian (Liu et al. 2025): every primitive exists with a probability that is learned.

In each training step a primitive is there or not, m in {0, 1}, drawn with the probability sigmoid(l) (Gumbel-softmax of
two classes, of whose scores l is the difference; straight through, temperature 1):

    C = Σ c m α T,  T <- T (1 - m α),  loss + 5e-4 (mean m)²

What is not drawn is not blended and its own parameters have no gradient, but m has: it learns what it would contribute.
That derivative is exact here (``walks/score.py`` with a share). Every 1,000 steps those go that ten draws do not show;
at step 25,000 those with the least probability, down to the budget, and all others exist from then on. In the paper
masks are learned while it densifies, too; here from the densified start on, at first with a probability of 98 %. In a
run of another length the step size of the scores changes inversely: they come as far.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.options import RasterOptions
from ...engine.parameters import device_array
from ...engine.project import DeviceCamera
from ...engine.view import prepare
from ...engine.walks.score import Sums, composite_score
from ...scores.score import ScoreRule
from ...training.presets import Recipe
from ...training.strategy.prune import keep_best
from ...training.strategy.scheduler import PruningRule, scaled_milestone
from ...training.train import Trainer

MASK = "mask_logits"
START_LOGIT = 4.0
RATE = 0.02  # of the difference of two scores that learn at 0.01 each
WEIGHT = 5e-4  # of the squared mean
SWEEP_EVERY, DRAWS = 1000, 10
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


class MaskGaussian(Trainer):
    """Draws masks from the end of densification to the prune."""

    @property
    def _masking(self) -> bool:
        begun = self.pruning is not None and (self.pruning.scheduler is not None or self.pruning.skipped)
        return not begun and self.step_count >= self.densification.stop

    def trained_params(self) -> dict:
        """Those that are drawn; the others cannot be seen."""
        if not self._masking:
            return self.optimizer.params
        if MASK not in self.optimizer.adam:
            rate = RATE * 30_000 / self.config.steps
            self.optimizer.learn(MASK, np.full(self.optimizer.n, START_LOGIT), rate)
        params = self.optimizer.params
        noise = device_array(self.rng.logistic(size=self.optimizer.n))
        self.probability = dr.rcp(1 + dr.exp(-dr.detach(params[MASK]) - noise))
        self.drawn = dr.select(self.probability > 0.5, mi.Float(1), mi.Float(0))
        return params | {"logit_opacities": dr.select(self.drawn > 0, params["logit_opacities"], ABSENT)}

    def _render(self, params: dict, view: int, probe: list | None = None) -> tuple:
        planes, frame = super()._render(params, view, probe)
        self.planes = planes
        return planes, frame

    def regularise(self, view: int, gradient: list) -> None:
        """Derivative by the masks, straight through the draw."""
        if not self._masking:
            return
        params = {name: dr.detach(value) for name, value in self.optimizer.params.items()}
        share, image, adjoint = (
            [dr.detach(value, preserve_type=False) for value in values]
            for values in ([self.drawn], self.planes, gradient)
        )
        by_m = mi.Float(by_share(params, self.cameras[view], self.options, share[0], image, adjoint))
        by_m += dr.mean(self.drawn) * (2 * WEIGHT / self.optimizer.n)
        dr.set_grad(self.optimizer.adam[MASK], by_m * self.probability * (1 - self.probability))

    def _control_density(self) -> list[str]:
        events = super()._control_density()
        every = scaled_milestone(SWEEP_EVERY, self.config.steps / 30_000)
        if MASK in self.optimizer.adam and self._masking and self.step_count % every == 0:
            n = self.optimizer.n
            absent = self.rng.logistic(size=(DRAWS, n)).max(0) < -self.optimizer.numpy(MASK)
            keep_best(self.optimizer, -absent.astype(float), max(int(np.sum(~absent)), int(self.config.target)))
            events += [f"{n - self.optimizer.n} primitives absent in {DRAWS} draws"] * (self.optimizer.n < n)
        return events

    def _scores(self) -> np.ndarray:
        """The masks', which are not needed any more."""
        result = self.optimizer.numpy(MASK)
        self.optimizer.forget(MASK)
        return result


RECIPE = Recipe(pruning=PruningRule(25_000, 25_000, division=(1.0,), rounds=1), score=ScoreRule("opacity"))
