"""Light paths as an operation on AD variables: their derivatives are replays, and its graph holds no path.

Its inputs are the parameters of the primitives. Parameters of the scene that the paths meet on their way, such as those
of materials and emitters, get their derivatives in the replays themselves, as those of Mitsuba's integrators do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from .transfer import three_channels
from .wavefront import add_to, joined, parted


@dataclass
class Replay:
    """What a derivative pass knows, and finds.

    Backward ``δL`` is given, and gradients add up in whatever is attached to the AD graph. Forward it is found.
    """

    L: Any  # of the primal pass
    δL: Any = None  # None: forward

    @property
    def forward(self) -> bool:
        return self.δL is None

    def begin(self, scene: Any) -> None:
        """Before the first segment; ``scene`` is what the paths meet."""
        if self.forward:
            params: Any = mi.traverse(scene)
            met = [params[name] for name in params.keys() if dr.grad_enabled(params[name])]
            dr.forward_to(met, flags=dr.ADFlag.ClearEdges | dr.ADFlag.AllowNoGrad)  # none, for a sensor of its own

    def differentiate(self, value: Any, sample: Any, found: Any) -> None:
        """Take the derivative of what lanes bring."""
        if not dr.grad_enabled(value):
            return
        if self.forward:
            # edges are cleared: calls of BSDFs look at all that leave a parameter, and stop at those of others.
            # Tangents stay: the next segment meets the same parameters, and what plugins computed from them
            dr.forward_to(value, flags=dr.ADFlag.ClearEdges)
            add_to(found, dr.grad(value), sample)
        else:
            δL = dr.gather(mi.Spectrum, self.δL, sample)
            with dr.isolate_grad():  # what all segments share is derived later
                dr.backward_from(δL * value)


def radiance(
    trace: Callable[[dict, Replay | None], Any], views: int, params: dict, derivative: bool
) -> list[list]:
    """What ``trace`` finds, three channels of each view, attached to the AD graph where ``params`` are.

    Args:
        trace: of parameters and a replay, or None: a spectrum, as ``LightPaths.radiance`` returns it.
        views: how many are traced in one wavefront.
        params: raw parameters of primitives as flat arrays.
        derivative: wanted for its graph; then it is attached in any case, for what the replay finds besides.
    """
    names = [name for name, value in params.items() if dr.is_float_v(value)]
    always = mi.Float(0)
    if derivative:
        dr.enable_grad(always)
    fixed = _Fixed(trace, views, params, names)
    found: Any = dr.custom(_Paths, fixed, [params[name] for name in names], always)
    return [three_channels(channels) for channels in found]


class _Fixed:
    """What has no derivative, as an object of which Dr.Jit sees nothing."""

    def __init__(self, trace: Callable, views: int, params: dict, names: list[str]):
        self.trace, self.views, self.names = trace, views, names
        self.others = {name: value for name, value in params.items() if name not in names}

    def with_values(self, values: list) -> dict:
        return self.others | dict(zip(self.names, values, strict=True))


class _Paths(dr.CustomOp):
    """Values of the parameters to channels of radiance of each view."""

    def eval(self, fixed: _Fixed, values: list, always: Any) -> list[list]:
        self.fixed, self.values = fixed, values
        self.L = fixed.trace(fixed.with_values(values), None)
        return parted(self.L, fixed.views)

    def backward(self) -> None:
        leaves = self._leaves()
        with dr.resume_grad():
            δL: Any = self.grad_out()
            replay = Replay(self.L, mi.Spectrum(joined(δL)))
            self.fixed.trace(self.fixed.with_values(leaves), replay)
        self.set_grad_in("values", [dr.grad(leaf) for leaf in leaves])

    def forward(self) -> None:
        leaves = self._leaves()
        dr.set_grad(leaves, self.grad_in("values"))
        with dr.resume_grad():
            δL = self.fixed.trace(self.fixed.with_values(leaves), Replay(self.L))
        self.set_grad_out(parted(δL, self.fixed.views))

    def _leaves(self) -> list:
        """The parameters as variables of their own, so that their gradients are those of this operation."""
        leaves = [mi.Float(value) for value in self.values]
        dr.enable_grad(leaves)
        return leaves
