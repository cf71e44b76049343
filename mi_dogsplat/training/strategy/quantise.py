"""The last part of a training sees the model as its file will have it, so that the file loses nothing that matters.

Rendered are the numbers of the file (``training/straight_through.py``), and at the end they become the model. Scales of
colour and of position, and the palette, follow the model in rounds: in each, every entry becomes the mean of the
primitives that are nearest to it, by how much they weigh in the training views (Σ α T over all pixels).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...formats.coded import CODED
from ...formats.grids import Extents, FileGrids, Palette, Steps
from ...formats.symmetries import nearest_to_identity
from ...scores.weights import weights
from ..events import Event
from ..optimizer import SplatOptimizer
from ..sh_rows import bands_of
from ..straight_through import StraightThrough
from .strategy import Strategy, Training

SHARE = 0.2  # of the run
ROUNDS = 15
SETTLED = 0.25  # of that part, in which the tables stay as they are: what is trained then is what the file says
LEAST_WEIGHT = 1e-3  # of what no view sees


@dataclass(frozen=True)
class Quantised(Event):
    """The model became what its file holds; ``entries`` of the palette."""

    kind, words = "quantised", "quantised for {format}: palette of {entries}"
    format: str
    entries: int


@dataclass
class Tables:
    """What the numbers are rounded to; empty before it begins."""

    extents: np.ndarray = field(default_factory=lambda: np.zeros(0))  # ``Extents.numbers``
    entries: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3), np.float32))
    degrees: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    labels: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    weights: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self.on_device: tuple[np.ndarray, StraightThrough] | None = None  # and the labels that it is made of

    @property
    def palette(self) -> Palette | None:
        """None before it begins."""
        return Palette(self.entries, self.degrees, self.labels) if len(self.labels) else None

    def fits(self, optimizer: SplatOptimizer) -> bool:
        """Whether bands are still those that the palette was made for."""
        return np.array_equal(self.degrees[self.labels], optimizer.sh_degrees)


@dataclass(frozen=True)
class Quantisation(Strategy[Tables]):
    """Straight-through quantisation for a format of ``CODED``."""

    format: str
    steps: Steps = Steps()

    def new_state(self, t: Training) -> Tables:
        return Tables()

    def before_step(self, t: Training, state: Tables) -> None:
        done = t.step_count - (t.steps - max(1, round(SHARE * t.steps)))
        if done < 0:
            return
        if state.palette is None:
            self._begin(t, state)
        moving = (1 - SETTLED) * SHARE * t.steps
        if not state.fits(t.optimizer) or (done <= moving and done % max(1, round(moving / ROUNDS)) == 0):
            self._follow(t, state)

    def params(self, t: Training, state: Tables, params: dict) -> dict:
        if state.palette is None:
            return params
        if state.on_device is None or state.on_device[0] is not state.labels:
            state.on_device = state.labels, StraightThrough(self._grids(state), state.palette, t.optimizer.bands)
        return state.on_device[1](params)

    def rearranged(self, state: Tables, index: np.ndarray, fresh: np.ndarray) -> None:
        if state.palette is not None:
            state.labels, state.weights = state.labels[index], state.weights[index]

    def after_step(self, t: Training, state: Tables) -> list[Event]:
        if t.step_count < t.steps or state.palette is None:
            return []
        splats = self._grids(state).snap(t.optimizer.to_splats(), state.palette)
        arrays = {name: getattr(splats, name) for name in ("means", "log_scales", "quats", "logit_opacities")}
        for name, values in (arrays | {"sh_dc": splats.sh_coeffs[:, 0]} | bands_of(splats)).items():
            t.optimizer.assign(name, values.reshape(t.optimizer.numpy(name).shape))
        return [Quantised(self.format, len(state.entries))]

    def _begin(self, t: Training, state: Tables) -> None:
        """Of the ways to write a rotation down take the shortest: the moments of the others mean nothing then."""
        splats = nearest_to_identity(t.optimizer.to_splats())
        for name in ("log_scales", "quats"):
            t.optimizer.assign(name, getattr(splats, name))
            t.optimizer.reset_moments(name)
        found = weights(t.optimizer.params, t.photographs.cameras, t.options).total
        state.weights = np.maximum(found, LEAST_WEIGHT)

    def _follow(self, t: Training, state: Tables) -> None:
        splats = t.optimizer.to_splats()
        state.extents = Extents.of(splats).numbers
        before = state.palette if state.fits(t.optimizer) else None
        new = self._grids(state).palette(splats, self.steps.entries, state.weights, before)
        state.entries, state.degrees, state.labels = new.entries, new.degrees, new.labels

    def _grids(self, state: Tables) -> FileGrids:
        return CODED[self.format](Extents.from_numbers(state.extents), self.steps)
