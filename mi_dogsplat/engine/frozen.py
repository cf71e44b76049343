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
from typing import ParamSpec, TypeVar

import drjit as dr

P = ParamSpec("P")
R = TypeVar("R")


def frozen(function: Callable[P, R]) -> Callable[P, R]:
    """The function as ``dr.freeze`` makes it, called while no garbage is collected. It may be recorded often: once per
    kind of scene and rule."""
    recorded = dr.freeze(function, warn_after=1 << 30)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        collecting = gc.isenabled()
        gc.disable()
        try:
            return recorded(*args, **kwargs)
        finally:
            if collecting:
                gc.enable()

    return call
