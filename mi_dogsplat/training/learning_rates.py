"""Adam's step size for each parameter at each step: the schedule of the 3DGS recipe, and larger ones after pruning."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..engine.parameters import RAW_DOG
from .milestones import scaled_milestone
from .sh_rows import SH_INDEX


@dataclass(frozen=True)
class Refinement:
    """Larger step sizes from pruning on, ours: few primitives have far to go, to where many were (docs/experiments.md).

    Factors on the step sizes of the 3DGS recipe; the first falls linearly to its end. So it stays large
    for longer than in an exponential fall, which is at a tenth of the gain after half of the run.
    """

    start: int  # step
    gain: float  # of all but the positions, at the start
    end_gain: float  # and at the end
    means_gain: float  # of the positions, all along

    def scaled(self, factor: float) -> Refinement:
        """The rule of a run ``factor`` times as long."""
        return replace(self, start=scaled_milestone(self.start, factor))

    def factor(self, name: str, step: int, total_steps: int) -> float:
        """On the step size of a parameter."""
        if step < self.start:
            return 1.0
        if name == "means":
            return self.means_gain
        progress = min((step - self.start) / max(total_steps - self.start, 1), 1.0)
        return self.gain + (self.end_gain - self.gain) * progress


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
    refinement: Refinement | None = None
    batch_views: int = 1  # K, views whose gradients a step averages

    @property
    def batch_gain(self) -> float:
        """√K, on every step size."""
        return math.sqrt(self.batch_views)

    def at(self, step: int) -> dict[str, float]:
        """Step size of every parameter."""
        progress = min(step / max(self.total_steps, 1), 1.0)
        means = self.extent * self.means_start * (self.means_end / self.means_start) ** progress
        names = ("log_scales", "quats", "logit_opacities", "sh_dc", "sh_rest", *RAW_DOG)
        rates = {"means": means} | {name: getattr(self, name) for name in names}
        if self.refinement:
            rates = {name: r * self.refinement.factor(name, step, self.total_steps) for name, r in rates.items()}
        rates |= dict.fromkeys(SH_INDEX, rates["sh_rest"])
        return {name: rate * self.batch_gain for name, rate in rates.items()}
