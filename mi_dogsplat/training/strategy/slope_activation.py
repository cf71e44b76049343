"""Colours that vary over their primitive in training: all primitives get slopes, and those that stay faint lose them.

Slopes begin at zero, so that the pictures stay what they are. They come when pruning is over: few primitives, each of
which stands for what several have shown before, gain most by them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...engine.parameters import device_array
from ...scene.sh_basis import C0
from ..events import Event, SlopesActivated, SlopesLeftOut
from ..milestones import scaled_milestone
from ..optimizer.splat_optimizer import SplatOptimizer
from .once import Once
from .strategy import Strategy, Training


@dataclass(frozen=True)
class SlopeRule:
    """Numbers of the recipe, for a run of 30,000 steps.

    Raises ``ValueError`` for a number out of range.
    """

    start: int = 25_000  # step at which all primitives get slopes
    least: float = 1 / 255  # per standard deviation: slopes that are below on all axes are left out at the end

    def __post_init__(self) -> None:
        if self.start < 0:
            raise ValueError(f"SlopeRule: start is {self.start}, expected a step")
        if not 0 <= self.least < np.inf:
            raise ValueError(f"SlopeRule: least is {self.least}, expected a change of colour")

    def scaled(self, factor: float) -> SlopeRule:
        """The rule of a run ``factor`` times as long."""
        return replace(self, start=scaled_milestone(self.start, factor))


def activate_slopes(optimizer: SplatOptimizer) -> int:
    """Give slopes of zero to every primitive, and return how many there are; those that have some keep them."""
    slopes = np.zeros((optimizer.n, 3, 3), np.float32)
    if optimizer.n_slopes:
        slopes[optimizer.slope_index] = optimizer.numpy("color_slopes").reshape(-1, 3, 3)
    optimizer.set_slopes(np.arange(optimizer.n), slopes)
    return optimizer.n


def shown_slopes(rule: SlopeRule, optimizer: SplatOptimizer) -> np.ndarray:
    """[S] whether slopes are large enough to be seen: a pixel shows no more than their largest entry, or hardly.

    At r standard deviations the change is at most √3 r times that entry, and the blend at most exp(-r²/2): 1.05 times.
    Linear colours are looked at through the curve of the loss, at the colour of the primitive.
    """
    changes = np.abs(optimizer.numpy("color_slopes").reshape(-1, 3, 3))
    if optimizer.curve:
        colors = np.maximum(C0 * optimizer.numpy("sh_dc")[optimizer.slope_index] + 0.5, 0)
        changes *= optimizer.curve.slope(device_array(colors)).numpy().reshape(-1, 1, 3)
    return changes.max(axis=(1, 2)) >= rule.least


@dataclass(frozen=True)
class SlopeControl(Strategy[None]):
    """At the end of the run, slopes that no pixel shows are left out, before anybody looks at the size of the file."""

    rule: SlopeRule

    def end(self, t: Training, state: None) -> list[Event]:
        before = t.optimizer.n_slopes
        shown = shown_slopes(self.rule, t.optimizer) if before else np.zeros(0, bool)
        if shown.all():
            return []
        slopes = t.optimizer.numpy("color_slopes")[shown].reshape(-1, 3, 3)
        t.optimizer.set_slopes(t.optimizer.slope_index[shown], slopes)
        return [SlopesLeftOut(before - int(shown.sum()), t.optimizer.n_slopes)]


@dataclass(frozen=True)
class SlopeActivation(Once):
    """``activate_slopes`` at the step of the rule."""

    rule: SlopeRule

    @property
    def start(self) -> int:
        return self.rule.start

    def act(self, t: Training) -> list[Event]:
        return [SlopesActivated(activate_slopes(t.optimizer))]
