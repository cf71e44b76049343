"""Exposure and white balance of each training image, as an affine map of colours learned beside the model.

As in the 3DGS release (Kerbl et al., July 2024): a rendered colour c becomes A c + b, a [3, 4] matrix per image that
begins as the identity, has a learning rate of its own, and Adam. What cameras did to single images then stays out of
the model. No map is applied when the model is seen or measured on test views: its colours are those before the maps.

Ours is what fixes them: a gain common to all maps, undone by the colours of the model, changes no training image, but
every test view. So a map is I + X - mean of all X, of which the mean is the identity whatever Adam does to X. And since
colours depend on the direction, they can undo the map of a single view as well: what no photograph asks for is pulled
back to the identity (decoupled weight decay, Loshchilov and Hutter 2019).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import numpy as np

from ..engine.arrays import detached
from ..engine.parameters import device_array

ENTRIES = 12  # of a map: three rows of A and b
RATE, END_RATE = 0.01, 0.001  # of Adam; falls log-linearly
PULL = 20.0  # share of a map's distance to the identity that is taken back at each of its steps, times the rate
BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-15
IDENTITY = np.eye(3, 4, dtype=np.float32).ravel()
ARRAYS = ("values", "m", "v")


class Exposure:
    """A map per training view. Planes are detached: derivatives are written out by hand, as those of the loss."""

    values: list  # of each view: 12 entries of I + X
    m: list  # and their moments
    v: list
    t: list[int]  # steps taken
    mean_x: Any  # mean of all X, 12 entries

    def __init__(self, n_views: int, total_steps: int):
        self.total_steps = total_steps
        self.identity = detached(device_array(IDENTITY))
        self.restore({"values": np.tile(IDENTITY, (n_views, 1)), "t": np.zeros(n_views, np.int64)})

    def applied(self, planes: list, view: int) -> list:
        """Three planes [H*W] as the camera of a view recorded them."""
        c, e = detached(planes), self._entries(view)
        return [dr.fma(e[k], c[0], dr.fma(e[k + 1], c[1], dr.fma(e[k + 2], c[2], e[k + 3]))) for k in (0, 4, 8)]

    def backward(self, planes: list, gradient: list, view: int, step: int) -> list:
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

    def numpy(self) -> np.ndarray:
        """The maps, [V, 3, 4]."""
        return np.array([(v - self.mean_x).numpy() for v in self.values]).reshape(-1, 3, 4)

    def state(self) -> dict[str, np.ndarray]:
        """What ``restore`` needs to go on with the same bits."""
        arrays = {name: np.array([row.numpy() for row in getattr(self, name)]) for name in ARRAYS}
        return arrays | {"t": np.array(self.t), "mean_x": self.mean_x.numpy()}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Take over a ``state()``; moments that are left out are zero, a mean is found. Raises ``KeyError``."""
        values = saved["values"]
        for name in ARRAYS:
            setattr(self, name, [detached(device_array(row)) for row in saved.get(name, np.zeros_like(values))])
        mean_x = saved.get("mean_x", values.mean(axis=0) - IDENTITY)  # rounded otherwise than step by step
        self.mean_x = detached(device_array(mean_x))
        self.t = [int(t) for t in saved["t"]]
