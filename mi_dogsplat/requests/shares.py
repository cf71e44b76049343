"""A model on the device, whole or its most important primitives, for viewports that move."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..engine.parameters import upload
from ..formats.read import read_model
from ..scene.opacity import sigmoid
from ..scene.splats import Splats


class Shares:
    """A model of a file. Raises ``DataError``."""

    def __init__(self, path: Path):
        model = read_model(path)
        self.splats, self.drawing = model.splats, model.drawing
        self._ranks: np.ndarray | None = None
        self._parts: dict[int, dict] = {}  # by their number of primitives: all of them, and the latest share

    def part(self, share: float) -> dict:
        """Parameters as ``upload`` makes them, of at least one primitive where there are any."""
        n, count = self.splats.n_splats, self._count(share)
        if count not in self._parts:
            self._parts = {size: part for size, part in self._parts.items() if size == n}
            self._parts[count] = upload(self.splats if count == n else self.splats.select(self._first(count)))
        return self._parts[count]

    def chosen(self, share: float) -> np.ndarray | None:
        """Numbers of the primitives of a ``part``; None: all."""
        count = self._count(share)
        return None if count == self.splats.n_splats else self._first(count)

    def _count(self, share: float) -> int:
        n = self.splats.n_splats
        return min(max(round(share * n), 1), n)

    def _first(self, count: int) -> np.ndarray:
        """Those of most importance, in the order of the file."""
        if self._ranks is None:
            self._ranks = np.argsort(-importance(self.splats), kind="stable")
        return np.sort(self._ranks[:count])


def importance(splats: Splats) -> np.ndarray:
    """How much a primitive is likely to be seen, [N]: opacity times the area of its largest cross-section."""
    log_scales = np.sort(splats.log_scales.astype(np.float64), axis=1)
    opacities = sigmoid(splats.logit_opacities.astype(np.float64))
    return opacities * np.exp(np.clip(log_scales[:, 1] + log_scales[:, 2], -700, 700))
