"""Adam's step size for each parameter at each step: the schedule of the 3DGS recipe, and larger ones after pruning."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...engine.parameters import RAW_OF_GROUPS
from ..milestones import FromStep
from .preconditioning import Preconditioning
from .sh_rows import SH_INDEX

FEW_VIEWS = 50  # up to which view-dependent colour has no factor of its own: docs/experiments/step_sizes.md


@dataclass(frozen=True)
class Refinement(FromStep):
    """Larger step sizes from pruning on, ours: few primitives have far to go, to where many were
    (docs/experiments/step_sizes.md).

    Factors on the step sizes of the 3DGS recipe; the first falls linearly to its end. So it stays large
    for longer than in an exponential fall, which is at a tenth of the gain after half of the run.

    View-dependent colour has a factor of its own besides, which grows with the number of training views up to
    ``sh_gain``: what few views see from few sides is learned by heart. The factor of positions falls with the root
    of the number of primitives, as the distances between them on a surface do.
    """

    start: int  # step
    gain: float  # of all but the positions, at the start
    end_gain: float  # and at the end
    means_gain: float  # of the positions, all along
    few: int | None = None  # primitives, up to which that holds, and above which it falls; None: it never does
    sh_gain: float = 1.0  # of SH above degree 0 where views are many
    growth_gain: float = 1.0  # of all, before the start

    def factor(self, name: str, step: int, total_steps: int, views: int, n: int) -> float:
        """On the step size of a parameter, with that many training views and ``n`` primitives."""
        if step < self.start:
            return self.growth_gain
        if name == "means":
            return self.means_gain if self.few is None else self.means_gain * min(math.sqrt(self.few / n), 1.0)
        progress = min((step - self.start) / max(total_steps - self.start, 1), 1.0)
        gain = self.gain + (self.end_gain - self.gain) * progress
        return gain * min(max(views / FEW_VIEWS, 1.0), self.sh_gain) if name == "sh_rest" else gain


@dataclass(frozen=True)
class LearningRates:
    """Adam step sizes of the 3DGS recipe (Kerbl et al. 2023; method notes, Sec. 2), for a step of one view.

    The mean gradient of K views has a Kth of the variance, so a step may be √K times as large (Malladi et al. 2022).
    """

    extent: float  # radius of the camera positions, world units: the unit of position steps
    total_steps: int
    means_start: float = 1.6e-4  # times the extent; decays log-linearly to
    means_end: float = 1.6e-6  # times the extent
    log_scales: float = 5e-3
    quats: float = 1e-3
    logit_opacities: float = 0.025
    sh_dc: float = 2.5e-3
    sh_rest: float = 2.5e-3 / 20  # and of the groups of a mixed model
    dog_logit_opacities: float = 0.025
    dog_log_scales: float = 5e-3
    color_slopes: float = 2.5e-3
    brightness_curvatures: float = 2.5e-3
    cut_normals: float = 0.0625  # 25 times that of slopes: a normal that cuts is some units long
    second_cut_normals: float = 0.0625
    view_shifts: float = 5e-3  # as of scales: both are in standard deviations
    mean_views: float = 0.0  # they stay: where a primitive is stored moves
    refinement: Refinement | None = None
    preconditioning: Preconditioning | None = None
    batch_views: int = 1  # K, views whose gradients a step averages
    views: int = 1  # of the training, in all

    @property
    def batch_gain(self) -> float:
        """√K, on every step size."""
        return math.sqrt(self.batch_views)

    def at(self, step: int, n: int = 1) -> dict[str, float]:
        """Step size of every parameter in a model of ``n`` primitives; without that, in one of few."""
        progress = min(step / max(self.total_steps, 1), 1.0)
        means = self.extent * self.means_start * (self.means_end / self.means_start) ** progress
        dense = ("log_scales", "quats", "logit_opacities", "sh_dc", "sh_rest")
        rates = {"means": means} | {name: getattr(self, name) for name in (*dense, *RAW_OF_GROUPS)}
        if rule := self.refinement:
            here = step, self.total_steps, self.views, n
            rates = {name: rate * rule.factor(name, *here) for name, rate in rates.items()}
        rates |= dict.fromkeys(SH_INDEX, rates["sh_rest"])
        return {name: rate * self.batch_gain for name, rate in rates.items()}
