"""Numbers that all primitives share, such as those of a pose, as arrays with a lane for each.

The derivative by a number is a sum over all lanes for each of its uses, and Dr.Jit evaluates what is summed use by use:
a kernel each, of which every one repeats what leads to it. As one operation, all uses add up lane by lane first, all
numbers are evaluated by one kernel, and each is summed once.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi


def in_each_lane(numbers: list, n: int) -> list:
    """Numbers as arrays of ``n`` lanes where one of them has derivatives, else as they are."""
    return list(dr.custom(_InEachLane, numbers, n)) if dr.grad_enabled(numbers) else numbers


class _InEachLane(dr.CustomOp):
    def eval(self, numbers: list, n: int) -> list:
        self.n = n
        return [self._repeated(number) for number in numbers]

    def backward(self) -> None:
        adjoints: Any = self.grad_out()
        dr.eval(adjoints)
        self.set_grad_in("numbers", [dr.sum(adjoint) for adjoint in adjoints])

    def forward(self) -> None:
        tangents: Any = self.grad_in("numbers")
        self.set_grad_out([self._repeated(tangent) for tangent in tangents])

    def _repeated(self, number: Any) -> mi.Float:
        return dr.select(dr.arange(mi.UInt32, self.n) < self.n, number, mi.Float(0))  # an array, as Dr.Jit sees it
