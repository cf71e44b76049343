"""One step of Adam on all its arrays. What it does to them is up to the library (``mi.ad.Adam``) on the CPU.

On a GPU the host takes longer to ask for that, array by array, than a small model takes for its kernels. There the same
rule is one function that is replayed, and step sizes come from the host, which knows how many steps were taken.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ...engine.arrays import array_types, detached
from ...engine.frozen import frozen_for_sizes
from .adam import Entry, biases, step_without

MAX_GRADIENT = 1e18  # its square is a float32


def adam_step(adam: mi.ad.Adam, unused: Collection[str], wanted: Collection[str]) -> dict[str, tuple]:
    """Step by the gradients on the arrays, but not with the arrays ``unused``, for which the step counts all the same.
    A gradient that is not finite, or whose square is not, counts as zero. Returns (value before it, gradient) of the
    arrays ``wanted``."""
    return (library_step if array_types().is_llvm else replayed_step)(adam, unused, wanted)


def library_step(adam: mi.ad.Adam, unused: Collection[str], wanted: Collection[str]) -> dict[str, tuple]:
    """The same, on any backend."""
    for value in [value for name, value in adam.items() if name not in unused]:
        dr.set_grad(value, _finite(dr.grad(value)))
    before = {name: (detached(adam[name]), detached(dr.grad(adam[name]))) for name in wanted}
    step_without(adam, set(unused))
    return before


def replayed_step(adam: mi.ad.Adam, unused: Collection[str], wanted: Collection[str]) -> dict[str, tuple]:
    """The same, on any backend; its values may be rounded otherwise."""
    entries = {name: Entry.of(adam, name) for name in adam}
    used = [name for name in entries if name not in unused]
    stepping = [entries[name] for name in used]
    arrays = [[detached(x) for x in (dr.grad(e.value), e.value, e.m, e.v)] for e in stepping]
    sizes = [detached(dr.opaque(mi.Float, _step_size(adam, e))) for e in stepping]
    rule = adam.beta_1, adam.beta_2, adam.epsilon
    stepped, gradients = _stepped(arrays, sizes, rule, tuple(used.index(name) for name in wanted))
    before = {name: (arrays[used.index(name)][1], g) for name, g in zip(wanted, gradients, strict=True)}
    for name, entry in entries.items():
        if name in unused:
            replace(entry, t=entry.t + 1).put(adam, name)
    for name, e, moved in zip(used, stepping, stepped, strict=True):
        value, m, v = map(mi.Float, moved)
        dr.enable_grad(value)
        replace(e, value=value, t=e.t + 1, m=m, v=v).put(adam, name)
    return before


def _finite(gradient: Any) -> Any:
    return dr.select(dr.abs(gradient) < MAX_GRADIENT, gradient, 0)  # false for NaN


def _step_size(adam: mi.ad.Adam, entry: Entry) -> float:
    of_m, of_v = biases(adam, entry.steps + 1)
    return -entry.rate * math.sqrt(of_v) / of_m


@frozen_for_sizes
def _stepped(arrays: list, sizes: list, rule: tuple, wanted: tuple) -> tuple[list, list]:
    """(value, m, v of each array after a step, gradients ``wanted``, by their numbers)."""
    beta_1, beta_2, epsilon = rule
    stepped, gradients = [], []
    for size, (gradient, value, m, v) in zip(sizes, arrays, strict=True):
        gradient = _finite(gradient)
        m, v = dr.lerp(gradient, m, beta_1), dr.lerp(dr.square(gradient), v, beta_2)
        stepped.append([dr.fma(m * dr.rsqrt(v + epsilon**2), size, value), m, v])
        gradients.append(gradient)
    return stepped, [gradients[k] for k in wanted]
