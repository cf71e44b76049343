"""``dr.freeze`` for the kernels of this package: traced once per kind of arguments, replayed from then on.

While Dr.Jit 1.5 records a function, the thread takes no work that could not be replayed. The destructor of a Mitsuba
scene or texture, or of an array that shares memory with NumPy, hands in such work; it throws, and an exception in a
destructor ends the process ("RecordThreadState::enqueue_host_func(): this function cannot be recorded!"). Objects in
reference cycles go when Python collects garbage, which may be at any allocation: so it waits while a function runs.
"""

from __future__ import annotations

import functools
import gc
from collections.abc import Callable
from typing import Generic, ParamSpec, TypeVar

import drjit as dr

P = ParamSpec("P")
R = TypeVar("R")


class Frozen(Generic[P, R]):
    """A function as ``dr.freeze`` makes it, called while no garbage is collected. It may be recorded often: once per
    kind of scene and rule.

    A literal argument that has had different values is an array from then on: what a call launches depends on the
    calls before it.
    """

    def __init__(self, function: Callable[P, R]):
        functools.update_wrapper(self, function)
        self._recorded = dr.freeze(function, warn_after=1 << 30)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        collecting = gc.isenabled()
        gc.disable()
        try:
            return self._recorded(*args, **kwargs)
        finally:
            if collecting:
                gc.enable()

    def clear(self) -> None:
        """Forget all recordings, and what the calls so far were like."""
        self._recorded.clear()


def frozen(function: Callable[P, R]) -> Frozen[P, R]:
    """Decorator."""
    return Frozen(function)
