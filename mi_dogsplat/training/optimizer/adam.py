"""The state of ``mi.ad.Adam``, which has no public way in: the one place that knows how it is laid out.

Dr.Jit 1.5 holds a tuple per parameter, ``(value, promoted, learning rate, (t, m, v, v_max))``; a test looks at it with
the version that is installed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.parameters import device_array

CHECKED_WITH = "1.5"  # version of Dr.Jit


@dataclass(frozen=True)
class Moved:
    """Rows of parameters where they are to be, on the device once for all parameters that have them."""

    rows: mi.UInt32  # [R] old row of each new one
    fresh: mi.Bool  # [R] whether a row starts with zero moments

    @staticmethod
    def of(rows: np.ndarray, fresh: np.ndarray) -> Moved:
        """From the host."""
        return Moved(device_array(rows, mi.UInt32), mi.Bool(fresh))

    def __len__(self) -> int:
        return dr.width(self.rows)


@dataclass(frozen=True)
class Entry:
    """What Adam holds of a parameter."""

    value: Any
    promoted: Any
    rate: Any
    t: Any  # steps taken, as an array of one
    m: Any
    v: Any
    v_max: Any  # of AMSGrad, which is off

    @property
    def steps(self) -> int:
        """Taken so far. A literal holds them as long as no frozen function gets it, so that nothing waits."""
        return int(self.t[0])

    @staticmethod
    def of(adam: mi.ad.Adam, name: str) -> Entry:
        """The entry of a parameter."""
        state: Any = adam.state[name]
        value, promoted, rate, (t, m, v, v_max) = state
        return Entry(value, promoted, rate, t, m, v, v_max)

    def put(self, adam: mi.ad.Adam, name: str) -> None:
        """Make it that of a parameter."""
        state: Any = adam.state
        state[name] = self.value, self.promoted, self.rate, (self.t, self.m, self.v, self.v_max)

    def without_moments(self) -> Entry:
        """The same parameter after as many steps with gradients of zero."""
        zeros = (dr.opaque(type(x), 0, dr.width(x)) for x in (self.m, self.v))  # literals would compile another kernel
        return replace(self, **dict(zip("mv", zeros, strict=True)))

    def gathered(self, moved: Moved, size: int) -> Entry:
        """With the rows of ``size`` values that are named, and their moments unless they are fresh."""
        i = dr.arange(mi.UInt32, len(moved) * size)
        row = i // dr.opaque(mi.UInt32, size)
        old_row = dr.gather(mi.UInt32, moved.rows, row)
        at = dr.fma(old_row, size, i - row * size)
        keep = ~dr.gather(mi.Bool, moved.fresh, row)
        value = dr.gather(mi.Float, dr.detach(self.value), at)
        m, v = (dr.gather(type(x), x, at, keep) for x in (self.m, self.v))  # zero where fresh
        dr.eval(value, m, v)
        dr.enable_grad(value)
        return replace(self, value=value, m=m, v=v)


def biases(adam: mi.ad.Adam, steps: int) -> tuple[float, float]:
    """By which m and v are too small after so many steps, as they began with zero."""
    return 1 - adam.beta_1**steps, 1 - adam.beta_2**steps


def gather(adam: mi.ad.Adam, name: str, moved: Moved, size: int) -> None:
    """Take other rows of a parameter, of ``size`` values each; it is dropped when none is left."""
    if len(moved):
        Entry.of(adam, name).gathered(moved, size).put(adam, name)
    else:
        forget(adam, name)


def saved_entry(adam: mi.ad.Adam, name: str) -> dict[str, np.ndarray]:
    """A parameter on the host: its values under its name, moments ``.m`` and ``.v``, steps ``.t``, rate ``.rate``."""
    e = Entry.of(adam, name)
    numbers = {"t": np.array(e.steps, np.uint32), "rate": np.array(e.rate)}
    arrays = {name: to_host(e.value), f"{name}.m": to_host(e.m), f"{name}.v": to_host(e.v)}
    return arrays | {f"{name}.{key}": value for key, value in numbers.items()}


def restore_entry(adam: mi.ad.Adam, name: str, saved: Mapping[str, np.ndarray]) -> None:
    """Take over what ``saved_entry`` gave."""
    adam[name] = device_array(saved[name])  # registers the parameter
    entry, (m, v) = Entry.of(adam, name), (device_array(saved[f"{name}.{moment}"]) for moment in "mv")
    t, rate = type(entry.t)(int(saved[f"{name}.t"])), float(saved[f"{name}.rate"])
    replace(entry, t=t, rate=rate, m=m, v=v).put(adam, name)


def to_host(array: Any) -> np.ndarray:
    """A flat host copy."""
    return np.array(dr.detach(array).numpy())


def forget(adam: mi.ad.Adam, name: str) -> None:
    """Drop a parameter."""
    del adam.state[name]


def step_without(adam: mi.ad.Adam, unused: set[str]) -> None:
    """One step that neither reads nor writes the parameters ``unused``, but counts for them, too."""
    before: Any = dict(adam.state)
    held = {name: Entry.of(adam, name) for name in before if name in unused}
    adam.state = {name: entry for name, entry in before.items() if name not in unused}
    adam.step()
    stepped: Any = adam.state
    adam.state = before | stepped  # in the order from before: else kernels would change
    for name, entry in held.items():
        replace(entry, t=entry.t + 1).put(adam, name)
