"""Colours that vary over their primitive in training: all get slopes, or curvatures, and faint ones are left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...engine.parameters import device_array
from ...scene.row_groups import SLOPES, RowGroup
from ...scene.sh_basis import C0
from ..optimizer.splat_optimizer import SplatOptimizer
from .row_activation import RowRule


@dataclass(frozen=True)
class SlopeRule(RowRule):
    """``least``: per standard deviation; slopes, or curvatures, that are below in all entries are left out."""

    least_of = "colour"


def shown_slopes(rule: RowRule, optimizer: SplatOptimizer, group: RowGroup) -> np.ndarray:
    """[M] whether slopes, or curvatures, can be seen: a pixel shows no more than their largest entry, or hardly.

    At r standard deviations slopes change a colour by at most √3 r times that entry, curvatures by 3 r²/2 times. The
    blend is at most exp(-r²/2): 1.05 and 1.1 times. Linear colours are looked at through the curve of the loss, at the
    colour of the primitive.
    """
    (name,), index = group.names, optimizer.index_of(group)
    channels = 3 if group is SLOPES else 1
    changes = np.abs(optimizer.numpy(name).reshape(len(index), -1, channels))  # [M, entries, channels]
    if optimizer.curve:
        colors = np.maximum(C0 * optimizer.numpy("sh_dc")[index] + 0.5, 0)
        changes = changes * optimizer.curve.slope(device_array(colors)).numpy().reshape(-1, 1, 3)
    return changes.max(axis=(1, 2)) >= rule.least
