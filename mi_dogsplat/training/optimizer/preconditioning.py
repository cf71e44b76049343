"""Preconditioned steps: the numbers of a primitive move together (docs/preconditioning.md).

Adam divides each gradient by its usual size, as if the numbers of a primitive had nothing to do with each other. But a
primitive that is too large is too opaque as well, and one that lies too far left is also turned the wrong way: their
gradients go together, and Adam goes too far where they agree and not far enough where they do not. With Adam's
moments m̂ and v̂ of a primitive, and S the running mean of ĝ ĝᵀ, ĝ = g / √v̂, a step is

    Δ = -κ r ∘ (1 + λ) (C + λ I)⁻¹ (m̂ / √v̂),    C = D^-½ S D^-½,    D = diag(S),

with the step sizes r of the parameters. Where no gradients go together that is Adam, κ times as far. A matrix for each
block of parameters is the thought of K-FAC (Martens and Grosse 2015) and Shampoo (Gupta et al. 2018), whose blocks are
the layers of a network.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.arrays import detached
from ...scene.row_groups import DOG, PLANES, RowGroup
from ..milestones import FromStep
from .adam import Entry, biases
from .joint_steps import JointArray, Numbers, joint_steps
from .triangles import n_pairs, to_host, upload

IN_GROUPS = DOG, *PLANES
GROUP = {name: group for group in IN_GROUPS for name in group.names}
JOINT = ("means", "log_scales", "quats", "logit_opacities", "sh_dc", *GROUP)
"""Arrays whose numbers move together. Bands of colour, slopes, curvatures and shifts have steps of their own."""
ALL_HAVE = 14  # numbers of a primitive that are in no group
PRIOR = 0.2  # times the identity is what S begins with: nothing goes together
PRODUCTS = "products of "  # and names of arrays: that part of a state


@dataclass(frozen=True)
class Preconditioning(FromStep):
    """The rule, ours. Its numbers were chosen on validation views (docs/preconditioning.md).

    Raises ``ValueError`` for a number out of range.
    """

    start: int  # step
    gain: float = 1.5  # κ
    damping: float = 1.0  # λ
    memory: float = 0.9995  # part of S that the gradient of a view leaves

    def __post_init__(self) -> None:
        if self.start < 0:
            raise ValueError(f"Preconditioning: start is {self.start}, expected a step")
        for name in ("gain", "damping"):  # without damping there is no solution where two gradients are the same
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"Preconditioning: {name} is {getattr(self, name)}, expected a positive number")
        if not 0 <= self.memory < 1:
            raise ValueError(f"Preconditioning: memory is {self.memory}, expected a part below 1")


def n_products(groups: Collection[RowGroup]) -> int:
    """Entries of S for each primitive of a model with rows of these groups."""
    shapes = [shape for group in groups if group in IN_GROUPS for shape in group.arrays.values()]
    return n_pairs(ALL_HAVE + sum(map(math.prod, shapes)))


class Preconditioner:
    """S of each primitive, from the first step of the rule on.

    ``products`` are their lower triangles as they are kept (``triangles.py``); they have a row for each of ``columns``,
    a number of an array.
    """

    def __init__(self, rule: Preconditioning):
        self.rule = rule
        self.columns: list[tuple[str, int]] = []
        self.products: list[Any] = []

    @staticmethod
    def names(adam: mi.ad.Adam) -> list[str]:
        """Of the arrays whose numbers move together."""
        return [name for name in JOINT if name in adam]

    def step(
        self, adam: mi.ad.Adam, before: Mapping[str, tuple], sizes: Mapping[str, int], rows: Mapping[str, Any],
        views: int,
    ) -> None:  # fmt: skip
        """Put joint steps in the place of those that Adam has just taken.

        Args:
            before: (value, gradient) of the arrays ``names`` ahead of them (``adam_step``).
            sizes: of the rows of each array.
            rows: arrays of the groups (``GroupRows.params``).
            views: whose gradients were averaged.
        """
        entries = {name: Entry.of(adam, name) for name in before}
        arrays: dict[str, JointArray] = {}
        for name, e in entries.items():
            group = GROUP.get(name)
            of_group = (detached(rows[group.row]), detached(rows[group.index])) if group else (None, None)
            value, gradient = before[name]
            arrays[name] = JointArray(sizes[name], *of_group, value, gradient, detached(e.m), detached(e.v))
        self._know(arrays)
        of_arrays = [[self.rule.gain * e.rate, *biases(adam, e.steps)] for e in entries.values()]
        numbers = Numbers(PRIOR, self.rule.memory**views, self.rule.damping, adam.epsilon)
        opaque = [[detached(dr.opaque(mi.Float, number)) for number in row] for row in of_arrays]
        values, self.products = joint_steps(list(arrays.values()), opaque, self.products, numbers)
        for (name, entry), stepped in zip(entries.items(), values, strict=True):
            value = mi.Float(stepped)
            dr.enable_grad(value)
            replace(entry, value=value).put(adam, name)

    def rearranged(self, index: np.ndarray, fresh: np.ndarray) -> None:
        """After primitive r has become a copy of ``index[r]`` [N']; one that is ``fresh`` has had no gradients."""
        if self.columns:
            self._keep(np.where(fresh, _begun(self.columns), self._entries()[:, index]))

    def forget(self, name: str) -> None:
        """What the numbers of an array have to do with each other and with the rest, as its moments are forgotten."""
        if self.columns:
            forgotten = [[name in (a[0], b[0])] for a, b in _triangle(self.columns)]
            self._keep(np.where(forgotten, _begun(self.columns), self._entries()))

    def state(self) -> dict[str, np.ndarray]:
        """What ``restore`` needs; nothing before the first step of the rule."""
        if not self.columns:
            return {}
        return {PRODUCTS + "+".join(dict.fromkeys(name for name, _ in self.columns)): self._entries()}

    def restore(self, saved: Mapping[str, np.ndarray], sizes: Mapping[str, int], n: int) -> None:
        """Take over what ``state`` gave. Raises ``ValueError`` unless it is of ``n`` primitives."""
        self.columns, self.products = [], []
        for key in [key for key in saved if key.startswith(PRODUCTS)]:
            names = key[len(PRODUCTS) :].split("+")
            if set(names) <= set(JOINT):
                self.columns = [(name, k) for name in names for k in range(sizes[name])]
            if saved[key].shape != (n_pairs(len(self.columns)), n):
                raise ValueError(f'SplatOptimizer.restore: "{key}" of the state does not fit its {n} primitives')
            self._keep(saved[key])

    def _know(self, arrays: Mapping[str, JointArray]) -> None:
        """Entries for columns that are new."""
        columns = [(name, k) for name, array in arrays.items() for k in range(array.size)]
        if columns == self.columns:
            return
        n = dr.width(arrays["means"].value) // arrays["means"].size
        new = np.repeat(_begun(columns), n, axis=1)
        known = dict(zip(_triangle(self.columns), self._entries(), strict=True)) if self.columns else {}
        for values, pair in zip(new, _triangle(columns), strict=True):
            values[:] = known.get(pair, values)
        self.columns = columns
        self._keep(new)

    def _entries(self) -> np.ndarray:
        """[entries, N] on the host."""
        return to_host(self.products, n_pairs(len(self.columns)))

    def _keep(self, entries: np.ndarray) -> None:
        self.products = upload(entries)


def _begun(columns: list) -> np.ndarray:
    """[entries, 1] of what S begins with."""
    return np.array([[PRIOR if a == b else 0.0] for a, b in _triangle(columns)], np.float32)


def _triangle(columns: list) -> Iterator[tuple]:
    """Pairs of columns in the order of ``products``."""
    return ((a, b) for k, a in enumerate(columns) for b in columns[: k + 1])
