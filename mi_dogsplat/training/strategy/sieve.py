"""What leaves a training without being pruned: what is broken, and floaters in front of the lens.

A primitive very near to a training camera covers much of its picture, and no other view can judge it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.errors import DataError
from ..events import Dropped, Event
from .broken import drop_broken
from .strategy import Strategy, Training


def near_cameras(means: np.ndarray, positions: np.ndarray, distance: float) -> np.ndarray:
    """[N] whether a centre [N, 3] is nearer than ``distance`` to one of the camera positions [V, 3].

    Asked at each row of a history: by all N V distances a large model would take hours of a training.
    """
    # here: it is of the extra "train", which recipes, behind the flags of any command, do not need
    from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

    nearest, _ = cKDTree(positions).query(means, distance_upper_bound=distance)  # infinite where none is nearer
    return np.isfinite(nearest)


@dataclass(frozen=True)
class Sieve(Strategy[None]):
    """Removes what is ``broken`` and what is ``near_cameras`` whenever primitives are about to be counted."""

    near_zone: float = 0.0  # world units; 0: none

    def drop(self, t: Training) -> list[Event]:
        """Remove them. Raises ``FloatingPointError`` or ``DataError`` where nothing would be left."""
        events = self.drop_broken(t)
        if self.near_zone:
            near = self.near(t.optimizer.numpy("means"), t.photographs.positions)
            if near.any():
                t.optimizer.keep(np.flatnonzero(~near))
                events.append(Dropped(int(near.sum()), "primitives near cameras"))
        return events

    def near(self, means: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """``near_cameras`` by the zone. Raises ``DataError`` where all are."""
        near = near_cameras(means, positions, self.near_zone)
        if near.all():
            problem = f"every primitive is nearer than {self.near_zone:g} to a camera"
            raise DataError("--near-zone", problem, "use a smaller one")
        return near

    def drop_broken(self, t: Training) -> list[Event]:
        """Remove what is ``broken`` alone. Raises ``FloatingPointError`` where nothing would be left."""
        n = t.optimizer.n
        try:
            left = len(drop_broken(t.optimizer, t.extent))
        except FloatingPointError as error:
            raise FloatingPointError(f"step {t.step_count}: {error}") from None
        return [Dropped(n - left, "broken primitives")] if left < n else []

    def begin(self, t: Training, state: None) -> list[Event]:
        return self.drop(t) if t.step_count == 0 else []  # where a run goes on, its step has seen to it

    def after_step(self, t: Training, state: None) -> list[Event]:
        return self.drop(t) if t.due() else []
