"""3D Differences of Gaussians in training: activation, and density control by degeneration.

A primitive that is DoG is G - G_p: its pseudo-Gaussian has opacity a_p = f_a a and scales S_p = F S (method notes,
Sec. 5). After pruning all primitives become DoG; from then on those whose pseudo-Gaussian has faded below what a
pixel can show, or is not a number any more, turn into plain Gaussians, which cost nothing more than one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.activations import softplus
from ...engine.rows import NO_ROW
from ..events import DogActivated, Event
from ..milestones import FromStep
from ..optimizer.splat_optimizer import SplatOptimizer
from .once import Once
from .strategy import Strategy, Training

MAX_LOG_SCALE = 14.0  # of S_p, world units; beyond, the determinant of a screen covariance may overflow


@dataclass(frozen=True)
class DogRule(FromStep):
    """Numbers of the recipe, for a run of 30,000 steps; the start is the released code's.

    Raises ``ValueError`` for a number out of range.
    """

    start: int = 25_000  # step at which all primitives become DoG
    opacity: float = 0.5  # initial f_a; a small one leaves the image as it is
    scale: float | tuple[float, ...] = 1.6  # initial F, above 1: a ring; of several, primitives take turns
    control: bool = True  # whether faded pseudo-Gaussians are dropped
    min_opacity: float = 1 / 255  # of a pseudo-Gaussian, f_a a; below, no pixel shows it

    def __post_init__(self) -> None:
        if not 0 < self.opacity < 1:
            raise ValueError(f"DogRule: opacity (f_a) is {self.opacity}, expected a number between 0 and 1")
        if not 0 < self.min_opacity < 1:
            raise ValueError(f"DogRule: min_opacity is {self.min_opacity}, expected a number between 0 and 1")
        if self.start < 0:
            raise ValueError(f"DogRule: start is {self.start}, expected a step")
        if not np.all((np.asarray(self.scale) > 0) & np.isfinite(self.scale)):
            raise ValueError(f"DogRule: scale (F) is {self.scale}, expected F > 0")


def activate(rule: DogRule, optimizer: SplatOptimizer) -> int:
    """Make every primitive DoG, and return how many there are; those that already are stay as they are."""
    n, before = optimizer.n, optimizer.to_splats()
    logits = np.full(n, math.log(rule.opacity / (1 - rule.opacity)))
    log_scales = np.log(np.resize(rule.scale, n))[:, None] * np.ones(3)  # [N, 3]
    logits[before.dog_index], log_scales[before.dog_index] = before.dog_logit_opacities, before.dog_log_scales
    optimizer.set_dog(np.arange(n), logits, log_scales)
    return n


def degenerate(rule: DogRule, optimizer: SplatOptimizer) -> None:
    """Turn the DoG primitives whose pseudo-Gaussian has faded or is not finite into plain Gaussians.

    Meant for every step: one small kernel, and nothing waits for it. ``optimizer.n_dog`` tells how many are left.
    """
    if not rule.control:
        return
    params = dr.detach(optimizer.params)
    if "dog_row" not in params:
        return
    splat, row = dr.arange(mi.UInt32, optimizer.n), params["dog_row"]  # one lane per primitive
    is_dog = row != NO_ROW

    def dog(name: str, index) -> mi.Float:
        return dr.gather(mi.Float, params[name], index, is_dog)

    # log a_p = log sigmoid + log sigmoid: no faint product underflows
    log_opacity = -softplus(-params["logit_opacities"]) - softplus(-dog("dog_logit_opacities", row))
    shown = log_opacity >= math.log(rule.min_opacity)  # false for NaN
    for axis in range(3):
        log_scale = dr.gather(mi.Float, params["log_scales"], dr.fma(splat, 3, axis))
        log_scale += dog("dog_log_scales", dr.fma(row, 3, axis))
        shown &= dr.isfinite(log_scale) & (log_scale <= MAX_LOG_SCALE)
    optimizer.drop_dog(~shown)


@dataclass(frozen=True)
class DogControl(Strategy[None]):
    """``degenerate`` after every step, before anybody looks at the primitives."""

    rule: DogRule

    def after_step(self, t: Training, state: None) -> list[Event]:
        degenerate(self.rule, t.optimizer)
        return []


@dataclass(frozen=True)
class DogActivation(Once):
    """``activate`` at the step of the rule."""

    rule: DogRule

    @property
    def start(self) -> int:
        return self.rule.start

    def act(self, t: Training) -> list[Event]:
        psnr_before = t.test_psnr()
        return [DogActivated(activate(self.rule, t.optimizer), psnr_before)]
