"""``dr.freeze`` for the kernels of this package: traced once per kind of arguments, replayed from then on.

A call gives Dr.Jit its arrays, each once, and nothing else; what else the arguments are chooses the recording. For
where an object comes twice among the arguments, be it an array or a ``True``, Dr.Jit 1.5 takes one recording for
another: it is only "met before" to it, not which one, and ``(a, b, a)`` is replayed as ``(a, b, b)`` was. And a
dataclass takes it longer than all the arrays in it.

While it records a function, the thread takes no work that could not be replayed. The destructor of a Mitsuba scene or
texture, or of an array that shares memory with NumPy, hands in such work; it throws, and an exception in a destructor
ends the process ("RecordThreadState::enqueue_host_func(): this function cannot be recorded!"). Objects in reference
cycles go when Python collects garbage, which may be at any allocation: so it waits while a function runs.
"""

from __future__ import annotations

import functools
import gc
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from numbers import Number
from typing import Any, Generic, ParamSpec, TypeVar

import drjit as dr

from .arrays import array_types

KINDS_KEPT = 16  # of a function that is recorded for sizes
PLAIN = {bool, int, float, str, type(None)}  # types that ``repr`` tells apart, and their values
P = ParamSpec("P")
R = TypeVar("R")


class Frozen(Generic[P, R]):
    """A function as ``dr.freeze`` makes it, called while no garbage is collected. It may be recorded often: once per
    kind of scene and rule.

    A literal array that has had different values is none from then on: what a call launches depends on the calls of its
    kind before it.

    ``for_sizes``: arrays of other sizes are another kind, and only the latest kinds are kept. For functions with arrays
    whose size does not follow from what a kernel reads, such as those in which gradients add up: replayed with other
    arguments, Dr.Jit would give them the size that they had when the function was recorded.
    """

    def __init__(self, function: Callable[P, R], for_sizes: bool = False):
        functools.update_wrapper(self, function)
        self._function, self._for_sizes = function, for_sizes
        self._recordings: dict[str, Any] = {}

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Raises ``TypeError`` for an argument whose kind cannot be told, and what the function raises."""
        kind, arrays = described((args, kwargs))
        if self._for_sizes:
            kind = f"{kind} {[len(array) for array in arrays]}"
        recording = self._recordings.get(kind)
        if recording is None:
            call = _Call(self._function, args, kwargs, arrays)
            if self._for_sizes and len(self._recordings) == KINDS_KEPT:
                del self._recordings[next(iter(self._recordings))]
            recording = self._recordings[kind] = dr.freeze(call.of_arrays, warn_after=1 << 30)
        collecting = gc.isenabled()
        gc.disable()
        try:
            return recording(*arrays)
        except RuntimeError as error:  # Dr.Jit's own takes the place of that which ended a recording
            raise error.__cause__ or error from None
        finally:
            if collecting:
                gc.enable()

    @property
    def n_recordings(self) -> int:
        """That there are, of kinds and of what else Dr.Jit tells apart. It grows where that is told apart in vain."""
        return sum(recording.n_recordings for recording in self._recordings.values())

    def clear(self) -> None:
        """Forget all recordings, and what the calls so far were like."""
        self._recordings.clear()


class _Place(int):
    """Where an array was among the arguments: its number."""


class _Call(Generic[R]):
    """A function and its arguments but for the arrays, which it keeps no hold of."""

    def __init__(self, function: Callable[..., R], args: tuple, kwargs: dict, arrays: list):
        places = {id(array): _Place(k) for k, array in enumerate(arrays)}
        self.function = function
        self.args, self.kwargs = _mapped((args, kwargs), lambda leaf: places.get(id(leaf), leaf))

    def of_arrays(self, *arrays: Any) -> R:
        """The call with these arrays in their places."""
        args, kwargs = _mapped((self.args, self.kwargs), lambda leaf: arrays[leaf] if type(leaf) is _Place else leaf)
        return self.function(*args, **kwargs)


def _mapped(value: Any, change: Callable[[Any], Any]) -> Any:
    """Nested tuples, lists, dictionaries and dataclasses with other leaves."""
    kind: Any = type(value)
    if isinstance(value, (tuple, list)):
        items = [_mapped(item, change) for item in value]
        return kind(*items) if hasattr(kind, "_fields") else kind(items)
    if isinstance(value, dict):
        return kind((name, _mapped(item, change)) for name, item in value.items())
    if is_dataclass(value):
        return kind(**{name: _mapped(getattr(value, name), change) for name in _field_names(kind)})
    return change(value)


def described(value: Any) -> tuple[str, list]:
    """What nested tuples, lists, dictionaries and dataclasses are.

    Returns (all but what the arrays in them hold: structure, numbers and strings, each with its type, and which arrays
    are one and the same object; the arrays, each once).
    """
    words: list[str] = []
    arrays: dict[int, tuple[str, Any]] = {}
    _describe(value, words, arrays)
    return " ".join(words), [array for _, array in arrays.values()]


def _describe(value: Any, words: list[str], arrays: dict[int, tuple[str, Any]]) -> None:
    kind = type(value)
    if kind in PLAIN:
        words.append(repr(value))
    elif dr.is_array_v(kind):
        word, _ = arrays.setdefault(id(value), (f"#{len(arrays)}", value))
        words.append(word)
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


@functools.cache
def _field_names(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


def frozen(function: Callable[P, R]) -> Frozen[P, R]:
    """Decorator."""
    return Frozen(function)


def frozen_for_sizes(function: Callable[P, R]) -> Frozen[P, R]:
    """Decorator; recorded anew for arrays of other sizes."""
    return Frozen(function, for_sizes=True)


def zeros_for(values: Any, count: int, kind: Any = None) -> Any:
    """``count`` zeros for each of the evaluated ``values``, of floats unless another ``kind`` is asked for.

    For frozen functions: ``dr.zeros`` keeps the size that was recorded, while a kernel whose lanes are a multiple of
    what it reads keeps the multiple.
    """
    types = array_types()
    number = dr.arange(types.UInt, dr.width(values) * count) + types.UInt(dr.gather(type(values), values, 0))
    zero = (number >> 16) >> 16
    return zero if kind is types.UInt else dr.reinterpret_array(types.Float, zero)
