"""A few numbers per image or device that are learned beside the model: rows on the device, each with its own Adam."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import numpy as np

from ...engine.arrays import detached
from ...engine.parameters import device_array

BETA_1, BETA_2, EPSILON = 0.9, 0.95, 1e-15  # a row takes few steps, and large ones at first: to be forgotten soon
ARRAYS = ("values", "m", "v")


class RowsOfNumbers:
    """Rows that begin as zeros; a row rests until it takes a step (Kingma and Ba 2015, Alg. 1)."""

    values: list  # of each row
    m: list  # and its moments
    v: list
    t: list[int]  # steps taken

    def __init__(self, n_rows: int, rates: np.ndarray, most: float = np.inf):
        """``rates``: of each column, times that of a step; ``most``: no value gets beyond it."""
        self.rates, self.most = detached(device_array(rates)), most
        self.restore({"values": np.zeros((n_rows, len(rates))), "t": np.zeros(n_rows)})

    def step(self, row: int, gradient: Any, rate: float) -> Any:
        """A step of Adam; returns what it added to the row, where nothing was too much."""
        self.t[row] += 1
        t = self.t[row]
        unbiased = dr.opaque(type(gradient), -rate * np.sqrt(1 - BETA_2**t) / (1 - BETA_1**t))
        m, v = dr.lerp(gradient, self.m[row], BETA_1), dr.lerp(gradient * gradient, self.v[row], BETA_2)
        change = unbiased * self.rates * m / (dr.sqrt(v) + EPSILON)
        moved = self.values[row] + change
        self.values[row], self.m[row], self.v[row] = dr.minimum(moved, self.most), m, v
        dr.schedule(self.values[row], m, v)
        return change

    def numpy(self) -> np.ndarray:
        """[rows, columns]."""
        return np.array([row.numpy() for row in self.values])

    def state(self) -> dict[str, np.ndarray]:
        """What ``restore`` needs to go on with the same bits."""
        return {name: np.array([row.numpy() for row in getattr(self, name)]) for name in ARRAYS} | {
            "t": np.array(self.t)
        }

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Take over a ``state()``; moments that are left out are zero. Raises ``KeyError``."""
        values = saved["values"]
        for name in ARRAYS:
            setattr(self, name, [detached(device_array(row)) for row in saved.get(name, np.zeros_like(values))])
        self.t = [int(t) for t in saved["t"]]
