"""The kernel of preconditioned steps (``preconditioning.py``): a lane solves the equations of a primitive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from ...engine.arrays import array_types
from ...engine.frozen import frozen_for_sizes
from ...engine.rows import NO_ROW
from .triangles import entries_of, kept_of, n_pairs


@dataclass(frozen=True)
class JointArray:
    """One of the arrays whose numbers move together, flat and row-major, in rows of ``size`` numbers."""

    size: int
    row: Any  # [N] of each primitive, or NO_ROW; None where row i is that of primitive i
    primitive: Any  # [M] of each row; None likewise
    value: Any  # before the step
    gradient: Any
    m: Any  # with the gradient in it, as v
    v: Any

    def columns(self, flat: Any, n: int) -> list:
        """The numbers of a primitive in an array of that layout, [N] each; 0 for one without a row."""
        kinds = array_types()
        row = dr.arange(kinds.UInt, n) if self.row is None else self.row
        return [dr.gather(kinds.Float, flat, dr.fma(row, self.size, k), row != NO_ROW) for k in range(self.size)]

    def moved(self, directions: list, length: Any) -> Any:
        """The values that far along columns [N]."""
        kinds = array_types()
        i = dr.arange(kinds.UInt, dr.width(self.value))
        row = i // self.size
        number = i - row * self.size
        primitive = row if self.primitive is None else dr.gather(kinds.UInt, self.primitive, row)
        own = kinds.Float(0)
        for k, column in enumerate(directions):
            own += dr.gather(kinds.Float, column, primitive, number == k)  # 0 elsewhere
        return dr.fma(length, own, self.value)


@dataclass(frozen=True)
class Numbers:
    """Of the rule, and of Adam."""

    prior: float  # times the identity is S of what a primitive has had no gradients of
    memory: float
    damping: float
    epsilon: float


@frozen_for_sizes
def joint_steps(arrays: list[JointArray], of_arrays: list, products: list, numbers: Numbers) -> tuple[list, list]:
    """A step of each primitive.

    Args:
        arrays: whose numbers move together; the first one has a row for each primitive.
        of_arrays: of each array its step size, and what m and v are divided by, as they began with zero; [1] each.
        products: lower triangles of S before the step, as they are kept (``triangles.py``).

    Returns (values of the arrays, the triangles with this gradient in them). Numbers that a primitive does not have go
    together with nothing, also where it has had them before.
    """
    n = dr.width(arrays[0].value) // arrays[0].size
    normalised = _normalised(arrays, of_arrays, n, numbers.epsilon)
    new = _with_gradient(entries_of(products, n), normalised, numbers)
    directions = _solved(new, normalised.u, numbers.damping)
    kept = kept_of(new, n)
    dr.eval(kept, directions)  # else each array would solve the equations anew
    values = []
    for j, array in enumerate(arrays):
        own, directions = directions[: array.size], directions[array.size :]
        values.append(array.moved(own, -of_arrays[j][0]))
    return values, kept


@dataclass
class _Normalised:
    """Of a primitive, number by number, over the root of v: of all numbers about as large. [N] each."""

    g: list  # gradient
    u: list  # m
    there: list  # whether it has the number


def _normalised(arrays: list[JointArray], of_arrays: list, n: int, epsilon: float) -> _Normalised:
    found = _Normalised([], [], [])
    for array, (_, of_m, of_v) in zip(arrays, of_arrays, strict=True):
        columns = (array.columns(flat, n) for flat in (array.gradient, array.m, array.v))
        for gradient, m, v in zip(*columns, strict=True):
            scale = dr.sqrt(of_v) * dr.rsqrt(v + epsilon**2)
            found.g.append(gradient * scale)
            found.u.append(m / of_m * scale)
            found.there.append(True if array.row is None else array.row != NO_ROW)
    return found


def _with_gradient(before: list, normalised: _Normalised, numbers: Numbers) -> list:
    """Entries of the lower triangles of S: the mean of g gᵀ that falls off with ``memory``, the prior where a primitive
    has no such number."""
    g, there, new = normalised.g, normalised.there, []
    for k in range(len(g)):
        for j in range(k + 1):
            entry = dr.lerp(g[k] * g[j], before[n_pairs(k) + j], numbers.memory)
            new.append(dr.select(there[k] & there[j], entry, numbers.prior if j == k else 0))
    return new


def _solved(products: list, u: list, damping: float) -> list:
    """(1 + λ) (C + λ I)⁻¹ u with C_kj = S_kj / √(S_kk S_jj), by the factors L D Lᵀ of C + λ I: L z = u row by row as
    these are found, then Lᵀ x = D⁻¹ z from the last row on."""
    d = len(u)
    own = [products[n_pairs(k) + k] for k in range(d)]
    scale = [dr.select(square > 0, dr.rsqrt(square), 0) for square in own]
    lower: list[list] = []  # rows of L, without its diagonal of ones
    inverse: list = []  # of D
    x: list = []
    for k in range(d):
        row, times_d, pivot, value = [], [], type(u[k])(1 + damping), u[k]
        for j in range(k):
            entry = products[n_pairs(k) + j] * scale[k] * scale[j]
            for i in range(j):
                entry = dr.fma(-times_d[i], lower[j][i], entry)
            row.append(entry * inverse[j])
            times_d.append(entry)
            pivot = dr.fma(-entry, row[j], pivot)
            value = dr.fma(-row[j], x[j], value)
        lower.append(row)
        inverse.append(dr.rcp(pivot))
        x.append(value)
    x = [value * inverse[k] * (1 + damping) for k, value in enumerate(x)]
    for k in reversed(range(d)):
        for j in range(k + 1, d):
            x[k] = dr.fma(-lower[j][k], x[j], x[k])
    return x
