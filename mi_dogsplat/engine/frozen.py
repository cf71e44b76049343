"""``dr.freeze`` for the kernels of this package: traced once per kind of arguments, replayed from then on.

While Dr.Jit 1.5 records a function, the thread takes no work that could not be replayed. The destructor of a Mitsuba
scene or texture, or of an array that shares memory with NumPy, hands in such work; it throws, and an exception in a
destructor ends the process ("RecordThreadState::enqueue_host_func(): this function cannot be recorded!"). Objects in
reference cycles go when Python collects garbage, which may be at any allocation: so it waits while a function runs.

It also takes one recording for another. An object that it has met among the arguments before, be it an array or a
``True``, is only "met before" to it, not which one: ``(a, b, a)`` is replayed as ``(a, b, b)`` was. So each call has a
first argument that says it all.
"""

from __future__ import annotations

import functools
import gc
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from numbers import Number
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

        def of_kind(kind: str, args: Any, kwargs: Any) -> R:
            return cast(Any, function)(*args, **kwargs)

        self._recorded = dr.freeze(of_kind, warn_after=1 << 30)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Raises ``TypeError`` for an argument whose kind cannot be told."""
        collecting = gc.isenabled()
        gc.disable()
        try:
            return self._recorded(kind_of((args, kwargs)), args, kwargs)
        finally:
            if collecting:
                gc.enable()

    def clear(self) -> None:
        """Forget all recordings, and what the calls so far were like."""
        self._recorded.clear()


def kind_of(value: Any) -> str:
    """All of nested tuples, lists, dictionaries and dataclasses but what the arrays hold: structure, numbers and
    strings, each with its type, and which arrays are one and the same object."""
    words: list[str] = []
    _describe(value, words, {})
    return " ".join(words)


def _describe(value: Any, words: list[str], arrays: dict[int, int]) -> None:
    kind = type(value)
    if kind in PLAIN:
        words.append(repr(value))  # exact, and another one for 1, 1.0 and True
    elif dr.is_array_v(value):
        words.append(f"#{arrays.setdefault(id(value), len(arrays))}")
    elif isinstance(value, (tuple, list)):
        words.append(f"{kind.__name__}(")
        for item in value:
            _describe(item, words, arrays)
        words.append(")")
    elif isinstance(value, dict):
        words.append(f"{kind.__name__}(")
        for name, item in value.items():
            words.append(repr(name))
            _describe(item, words, arrays)
        words.append(")")
    elif is_dataclass(kind):
        words.append(f"{kind.__qualname__}(")
        for name in _field_names(kind):
            _describe(getattr(value, name), words, arrays)
        words.append(")")
    elif isinstance(value, (Number, str)):  # NumPy's, for example
        words.append(f"{kind.__name__} {value!r}")
    else:
        raise TypeError(f"a frozen function takes arrays, numbers, strings and what is made of them, not {value!r}")


PLAIN = {bool, int, float, str, type(None)}


@functools.cache
def _field_names(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(cast(Any, kind)))


def frozen(function: Callable[P, R]) -> Frozen[P, R]:
    """Decorator."""
    return Frozen(function)
