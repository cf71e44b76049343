"""Step sizes of linear colours: what they are in display-referred ones, seen through the tone curve of the loss.

A step of Adam has the same length whatever the gradient. In linear radiance one length fits neither shadows, which a
step of 0.0025 swings to black, nor lamps, which are thousands of them away. So Adam works on colours as the curve has
them, linearised where each primitive is: gradients are divided by the slope there, and so are the steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import mitsuba as mi

from ...scene.row_groups import CURVATURES, SLOPES
from ...scene.sh_basis import C0
from ..images.tone_curve import ToneCurve
from .sh_rows import SH_INDEX

INDEX = SH_INDEX | dict.fromkeys(SLOPES.names, SLOPES.index)
COLORS = ("sh_dc", "sh_rest", *INDEX)


class ColorSteps:
    """Changes of radiance for a change of 1 on the curve, for each coefficient of what colours are made of."""

    def __init__(self, curve: ToneCurve, values: Mapping[str, Any], sizes: Mapping[str, int], rows: Mapping[str, Any]):
        """``values``: parameters of the optimizer; ``sizes`` of their rows; ``rows``: primitives of groups' rows."""
        constant = dr.fma(C0, dr.detach(values["sh_dc"]), 0.5)  # [3 N]
        steps = dr.rcp(curve.slope(dr.maximum(constant, 0)))
        dr.eval(steps)
        self.of: dict[str, Any] = {"sh_dc": steps}
        for name in [name for name in values if name in COLORS[1:]]:
            i, size = dr.arange(mi.UInt32, dr.width(values[name])), dr.opaque(mi.UInt32, sizes[name])
            row = i // size
            channel = (i - row * size) % 3
            primitive = dr.gather(mi.UInt32, rows[INDEX[name]], row) if name in INDEX else row
            self.of[name] = dr.gather(mi.Float, steps, dr.fma(primitive, 3, channel))
        for name in [name for name in values if name in CURVATURES.names]:  # of all channels in one
            row = dr.arange(mi.UInt32, dr.width(values[name])) // dr.opaque(mi.UInt32, sizes[name])
            primitive = dr.gather(mi.UInt32, rows[CURVATURES.index], row)
            slopes = [dr.rcp(dr.gather(mi.Float, steps, dr.fma(primitive, 3, channel))) for channel in range(3)]
            self.of[name] = 3 * dr.rcp(slopes[0] + slopes[1] + slopes[2])

    def before(self, adam: Any) -> dict[str, Any]:
        """Give the gradients to Adam; returns the values that it starts from."""
        for name, step in self.of.items():
            dr.set_grad(adam[name], dr.grad(adam[name]) * step)
        return {name: dr.detach(adam[name]) for name in self.of}

    def after(self, adam: Any, start: Mapping[str, Any]) -> None:
        """Make steps of radiance of the steps that Adam took."""
        for name, step in self.of.items():
            adam[name] = dr.fma(dr.detach(adam[name]) - start[name], step, start[name])
