"""Means of the training error over the views since a row of the history, kept on the device."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import numpy as np

from ..engine.arrays import array_types


class LossMeans:
    """Adding a view waits for nothing; ``views`` is how many there were since the means were taken."""

    def __init__(self) -> None:
        self._set(0.0, 0.0, 0)

    def _set(self, l1_sum: float, loss_sum: float, views: int) -> None:
        Float = array_types().Float
        self.l1_sum, self.loss_sum, self.views = dr.opaque(Float, l1_sum), dr.opaque(Float, loss_sum), views

    def add(self, l1: Any, loss: Any) -> None:
        """Of a view."""
        self.l1_sum += l1
        self.loss_sum += loss
        self.views += 1
        dr.schedule(self.l1_sum, self.loss_sum)

    def take(self) -> dict[str, float]:
        """``l1`` and ``loss``; begins anew."""
        l1, loss = float(self.l1_sum[0]) / self.views, float(self.loss_sum[0]) / self.views
        self._set(0.0, 0.0, 0)
        return {"l1": l1, "loss": loss}

    def state(self) -> dict[str, np.ndarray]:
        """What ``restore`` needs."""
        return {"l1_sum": self.l1_sum.numpy().copy(), "loss_sum": self.loss_sum.numpy().copy(),
                "steps": np.array(self.views)}  # fmt: skip

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take over a ``state()``. Raises ``KeyError``."""
        self._set(float(state["l1_sum"][0]), float(state["loss_sum"][0]), int(state["steps"]))
