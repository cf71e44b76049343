"""Colours that vary over their primitive in training: all get slopes, and those that stay faint lose them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...engine.parameters import device_array
from ...scene.row_groups import SLOPES
from ...scene.sh_basis import C0
from ..events import SlopesActivated, SlopesLeftOut
from ..optimizer.splat_optimizer import SplatOptimizer
from .row_activation import RowActivation, RowControl, RowRule


@dataclass(frozen=True)
class SlopeRule(RowRule):
    """``least``: per standard deviation; slopes that are below on all axes are left out."""

    least_of = "colour"


def shown_slopes(rule: RowRule, optimizer: SplatOptimizer) -> np.ndarray:
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
class SlopeControl(RowControl):
    """Slopes that stay faint go at the end."""

    group, left_out = SLOPES, SlopesLeftOut

    def shown(self, optimizer: SplatOptimizer) -> np.ndarray:
        return shown_slopes(self.rule, optimizer)


@dataclass(frozen=True)
class SlopeActivation(RowActivation):
    """Every primitive gets slopes."""

    group, activated = SLOPES, SlopesActivated
