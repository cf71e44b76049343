"""The affine colour maps of the 3DGS release (Kerbl et al., July 2024), which the package had before: a contestant.

A rendered colour c becomes A c + b, a [3, 4] matrix per image that begins as the identity, has a learning rate of its
own, and Adam. Ours is what fixes them: the mean of all maps is the identity, and each is pulled back to it (decoupled
weight decay, Loshchilov and Hutter 2019). Where a ``Trainer`` keeps its ``Appearance`` they take its place.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from mi_dogsplat.engine.arrays import detached
from mi_dogsplat.engine.parameters import device_array

ENTRIES = 12  # of a map: three rows of A and b
RATE, END_RATE = 0.01, 0.001  # of Adam; falls log-linearly
PULL = 20.0  # share of a map's distance to the identity that is taken back at each of its steps, times the rate
BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-15
IDENTITY = np.eye(3, 4, dtype=np.float32).ravel()


class AffineMaps:
    """A map per training view. Planes are detached: derivatives are written out by hand, as those of the loss."""

    values: list  # of each view: 12 entries of I + X
    m: list  # and their moments
    v: list
    t: list[int]  # steps taken
    mean_x: Any  # mean of all X, 12 entries

    def __init__(self, n_views: int, total_steps: int):
        self.total_steps = total_steps
        self.identity = detached(device_array(IDENTITY))
        self.values, self.m, self.v = (
            [detached(device_array(row)) for _ in range(n_views)] for row in (IDENTITY, 0 * IDENTITY, 0 * IDENTITY)
        )
        self.t, self.mean_x = [0] * n_views, detached(device_array(0 * IDENTITY))

    def applied(self, planes: list, view: int, size: tuple[int, int]) -> list:
        """Three planes [H*W] as the camera of a view recorded them."""
        c, e = detached(planes), self._entries(view)
        return [dr.fma(e[k], c[0], dr.fma(e[k + 1], c[1], dr.fma(e[k + 2], c[2], e[k + 3]))) for k in (0, 4, 8)]

    def backward(self, planes: list, gradient: list, view: int, size: tuple[int, int], step: int) -> list:
        """The gradient by the planes, of that by ``applied``; the map of the view takes its step of Adam."""
        c, e = detached(planes), self._entries(view)
        products = [δ * factor for δ in gradient for factor in (*c, 1)]
        through = [sum((e[4 * j + i] * gradient[j] for j in (1, 2)), e[i] * gradient[0]) for i in range(3)]
        dr.eval(products, through)
        self._adam(view, dr.concat([dr.sum(product) for product in products]), step)
        return through

    def _entries(self, view: int) -> list:
        values = self.values[view] - self.mean_x
        dr.eval(values)
        return [dr.gather(type(values), values, k) for k in range(ENTRIES)]

    def _adam(self, view: int, gradient: Any, step: int) -> None:
        self.t[view] += 1
        t, progress = int(self.t[view]), min(step / max(self.total_steps, 1), 1.0)
        base = RATE * (END_RATE / RATE) ** progress
        rate = base * np.sqrt(1 - BETA_2**t) / (1 - BETA_1**t)
        m, v = dr.lerp(gradient, self.m[view], BETA_1), dr.lerp(gradient * gradient, self.v[view], BETA_2)
        x = self.values[view] - self.identity - self.mean_x
        change = dr.opaque(type(m), rate) * m / (dr.sqrt(v) + EPSILON) + dr.opaque(type(m), base * PULL) * x
        self.values[view], self.m[view], self.v[view] = self.values[view] - change, m, v
        self.mean_x -= change * dr.opaque(type(m), 1 / len(self.t))
        dr.schedule(self.values[view], m, v, self.mean_x)
