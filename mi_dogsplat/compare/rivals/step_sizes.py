"""Step sizes of the authors' code where it has others than the 3DGS recipe."""

from __future__ import annotations

from dataclasses import dataclass

from ...training.strategy.strategy import Strategy, Training


@dataclass(frozen=True)
class StepSizes(Strategy[None]):
    """Factors on the step sizes of the recipe, all along, by the names of the parameters."""

    factors: tuple[tuple[str, float], ...]

    def before_step(self, t: Training, state: None) -> None:
        t.optimizer.rate_factors |= dict(self.factors)


OPACITY_OF_2023 = StepSizes((("logit_opacities", 2.0),))  # 0.05, as in the first releases of 3DGS
