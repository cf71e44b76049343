"""3DGS-MCMC (Kheradmand et al. 2024): no pruning and no cloning by thresholds, but relocation and noise.

Every 100 steps from 500 to 25,000 primitives whose opacity is at most .005 become copies of live ones, drawn in
proportion to opacity, and 5 % new ones are added in the same way until the budget is there; what covered a place
before covers it still (``relocation.py``). After each step positions get noise,

    λ_noise λ_means σ(-100 (o - .005)) Σ η,   η normal, Σ the covariance in world space, λ_noise = 5e5

which moves the faint ones only; λ_means is the step size of positions. The loss has .01 mean o + .01 mean s beside it.
Primitives start with an opacity of .5, and a tenth as large as in 3DGS, as in the authors' code.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.activations import rotation_matrix
from ...engine.parameters import device_array
from ...training.events import Event
from ...training.milestones import scaled_milestone
from ...training.recipe import Recipe
from ...training.strategy.densify import Densification
from ...training.strategy.once import Done
from ...training.strategy.strategy import Seen, Strategy, Training
from .growth import opacities
from .relocation import draw, duplicate, relocate
from .step_sizes import OPACITY_OF_2023

DEVIATIONS = (
    "at least 60 rounds of growth, however short the run, at shorter intervals if necessary; moments of relocated "
    "rows begin at zero (the code: only those of their sources); copies get noise from the next step on (the code: in "
    "the same step)"
)
MIN_ROUNDS = 60  # of growth, 18 times as many with 5 % each
GATE, STEEPNESS = 0.995, 100.0  # of the noise, on 1 - opacity


@dataclass(frozen=True)
class Relocated(Event):
    """Dead primitives that became copies of live ones, and copies that were added."""

    kind, words = "relocated", "relocated {moved}, added {added}"
    moved: int
    added: int


@dataclass(frozen=True)
class Mcmc(Strategy[Done]):
    """Relocates, adds, regularises and shakes."""

    start: int = 500
    stop: int = 25_000
    every: int = 100
    growth: float = 1.05
    min_opacity: float = 0.005
    noise: float = 5e5  # times the step size of positions
    opacity_weight: float = 0.01
    scale_weight: float = 0.01
    first_opacity: float = 0.5
    first_size: float = 0.1  # of that of 3DGS

    def scaled(self, factor: float) -> Mcmc:
        start, stop = scaled_milestone(self.start, factor), scaled_milestone(self.stop, factor)
        return replace(self, start=start, stop=stop, every=max(1, min(self.every, (stop - start) // MIN_ROUNDS)))

    def new_state(self, t: Training) -> Done:
        return Done()

    def begin(self, t: Training, state: Done) -> list[Event]:
        if not state.done:
            state.done = True
            logit = np.log(self.first_opacity / (1 - self.first_opacity))
            t.optimizer.assign("logit_opacities", np.full(t.optimizer.n, logit))
            t.optimizer.assign("log_scales", t.optimizer.numpy("log_scales") + np.log(self.first_size))
        return []

    def due(self, t: Training, state: Done) -> bool:
        return self.start < t.step_count < self.stop and t.step_count % self.every == 0

    def after_backward(self, t: Training, state: Done, seen: Seen) -> None:
        """Gradients of the two means."""
        logits, log_scales = (t.optimizer.params[name] for name in ("logit_opacities", "log_scales"))
        opacity = dr.rcp(1 + dr.exp(-dr.detach(logits)))
        by_opacity = dr.opaque(mi.Float, self.opacity_weight / t.optimizer.n)
        by_scale = dr.opaque(mi.Float, self.scale_weight / (3 * t.optimizer.n))
        dr.set_grad(logits, dr.grad(logits) + opacity * (1 - opacity) * by_opacity)
        dr.set_grad(log_scales, dr.grad(log_scales) + dr.exp(dr.detach(log_scales)) * by_scale)

    def after_step(self, t: Training, state: Done) -> list[Event]:
        rates = replace(t.optimizer.learning_rates, refinement=None)  # noise is as published, whatever the steps are
        shake(t, self.noise * rates.at(t.step_count)["means"])
        if not self.due(t, state):
            return []
        opacity = opacities(t)
        dead = np.flatnonzero(opacity <= self.min_opacity)
        if len(dead) == len(opacity):
            return []
        live = np.where(opacity <= self.min_opacity, 0, opacity)
        relocate(t.optimizer, dead, draw(live, len(dead), t.rng), self.min_opacity)
        most, full = t.memory.bounded(int(t.target), t.optimizer.n) if t.memory else (int(t.target), None)
        added = max(0, min(most or 0, int(self.growth * t.optimizer.n)) - t.optimizer.n)
        duplicate(t.optimizer, draw(opacities(t), added, t.rng), self.min_opacity)
        events: list[Event] = [Relocated(len(dead), added)]
        return events + [full] if full and t.optimizer.n >= full.most else events


def shake(t: Training, amount: float) -> None:
    """Noise on the positions: ``amount`` times gate times covariance times a normal vector."""
    normal = device_array(t.rng.normal(size=(t.optimizer.n, 3)))
    t.optimizer.add("means", displacement(t.optimizer.params, normal, amount))


def displacement(params: dict[str, Any], normal: Any, amount: float) -> Any:
    """[N * 3] world units, row-major; ``normal`` likewise."""
    splat = dr.arange(mi.UInt32, dr.width(params["logit_opacities"]))

    def row(values: Any, size: int) -> list[mi.Float]:
        return [dr.gather(mi.Float, dr.detach(values), dr.fma(splat, size, k)) for k in range(size)]

    R = rotation_matrix(row(params["quats"], 4))
    variance = [dr.square(dr.exp(s)) for s in row(params["log_scales"], 3)]
    opacity = dr.rcp(1 + dr.exp(-dr.detach(params["logit_opacities"])))
    gate = dr.rcp(1 + dr.exp(-STEEPNESS * (1 - opacity - GATE))) * dr.opaque(mi.Float, amount)
    η = row(normal, 3)
    inside = [v * (R[0][k] * η[0] + R[1][k] * η[1] + R[2][k] * η[2]) for k, v in enumerate(variance)]  # S² Rᵀ η
    result = dr.zeros(mi.Float, 3 * dr.width(splat))
    for k in range(3):
        moved = R[k][0] * inside[0] + R[k][1] * inside[1] + R[k][2] * inside[2]
        dr.scatter(result, gate * moved, dr.fma(splat, 3, k))
    return dr.detach(result)


RECIPE = Recipe(densification=Densification(start=0, stop=0), also=(Mcmc(), OPACITY_OF_2023), start_share=1.0)
