"""``dr.freeze`` for the kernels of this package: traced once per kind of arguments, replayed from then on.

While Dr.Jit 1.5 records a function, the thread takes no work that could not be replayed. The destructor of a Mitsuba
scene or texture, or of an array that shares memory with NumPy, hands in such work; it throws, and an exception in a
destructor ends the process ("RecordThreadState::enqueue_host_func(): this function cannot be recorded!"). Objects in
reference cycles go when Python collects garbage, which may be at any allocation: so it waits while a function runs.

It also takes one recording for another where arguments differ in small integers or booleans only: of 64 combinations of
six booleans it tells 12 apart. So all that is not an array is hashed here, and told apart by that.
"""

from __future__ import annotations

import functools
import gc
from collections.abc import Callable, Hashable
from dataclasses import fields, is_dataclass
from typing import Any, Generic, ParamSpec, TypeVar, cast

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

        def of_kind(kind: int, args: Any, kwargs: Any) -> R:
            return cast(Any, function)(*args, **kwargs)

        self._recorded = dr.freeze(of_kind, warn_after=1 << 30)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        collecting = gc.isenabled()
        gc.disable()
        try:
            return self._recorded(hash(_constants((args, kwargs))), args, kwargs)
        finally:
            if collecting:
                gc.enable()

    def clear(self) -> None:
        """Forget all recordings, and what the calls so far were like."""
        self._recorded.clear()


def _constants(value: Any) -> Hashable:
    """What is not an array, and where it is, in nested tuples, lists, dictionaries and dataclasses."""
    if isinstance(value, (tuple, list)):
        return tuple([_constants(item) for item in value])
    if isinstance(value, dict):
        return tuple([(name, _constants(item)) for name, item in value.items()])
    if dr.is_array_v(value):
        return type(value)
    if is_dataclass(value) and type(value).__hash__ is None:
        return tuple([_constants(getattr(value, field.name)) for field in fields(value)])
    return value


def frozen(function: Callable[P, R]) -> Frozen[P, R]:
    """Decorator."""
    return Frozen(function)
