"""An optimizer whose model is seen as its file will have it: which grids and which palette, and when they follow it.

Grids and palette follow the model in rounds: in each, every entry of the palette becomes the mean of the primitives
that have it, by how much they weigh in the training views (Σ α T over all pixels), and each primitive gets the entry
that is nearest. Then they stay as they are, and what is trained is what the file says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...engine.device_camera import DeviceCamera
from ...engine.options import RasterOptions
from ...formats.coded import CODED, STEPS
from ...formats.grids import MOST_ENTRIES, Extents, FileGrids, Palette, Steps
from ...formats.symmetries import nearest_to_identity
from ...scene.opacity import sigmoid
from ...scene.row_groups import CURVATURES, PLANES, SHIFTS, SLOPES
from ...scores.weights import weights
from ..optimizer.faded import drop_faded
from ..optimizer.sh_rows import bands_of
from ..optimizer.splat_optimizer import SplatOptimizer
from .room import Room
from .straight_through import StraightThrough

ROUNDS = 15
SETTLED = 0.25  # of all steps, at the end, in which grids and palette stay as they are
LEAST_WEIGHT = 1e-3  # of what no view sees


@dataclass
class Coding:
    """What the numbers are rounded to, grids and a palette; empty before ``Quantiser.before_step``."""

    extents: np.ndarray = field(default_factory=lambda: np.zeros(0))  # of the grids, ``Extents.numbers``
    entries: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3), np.float32))  # of the palette
    degrees: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    labels: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))  # entry of each primitive
    weights: np.ndarray = field(default_factory=lambda: np.zeros(0))  # of each primitive in the views

    def __post_init__(self) -> None:
        self.on_device: tuple[np.ndarray, StraightThrough] | None = None  # and the labels that it is made of

    @property
    def palette(self) -> Palette | None:
        """None before it begins."""
        return Palette(self.entries, self.degrees, self.labels) if len(self.labels) else None

    def rearrange(self, index: np.ndarray) -> None:
        """Primitive r is a copy of the old one ``index[r]`` now."""
        if len(self.labels):
            self.labels, self.weights = self.labels[index], self.weights[index]


@dataclass(frozen=True)
class Quantiser:
    """Straight-through quantisation for a format of ``CODED``."""

    format: str
    steps: Steps | None = None  # those of ``formats/coded.STEPS``
    room: Room | None = None  # of a file whose size is given

    def before_step(
        self,
        coding: Coding,
        optimizer: SplatOptimizer,
        cameras: Sequence[DeviceCamera],
        options: RasterOptions,
        step: int,
        of: int,
    ) -> None:
        """Renew the coding where that is due before a step, 0..``of`` - 1, of those that see the file."""
        if coding.palette is None:
            self._begin(coding, optimizer, cameras, options)
        moving = (1 - SETTLED) * of
        if not _keeps_bands(coding, optimizer) or (step <= moving and step % max(1, round(moving / ROUNDS)) == 0):
            self._renew(coding, optimizer)

    def params(self, coding: Coding, params: dict, bands: Sequence[str]) -> dict:
        """What is rendered instead of the parameters of an optimizer with these ``bands``."""
        if coding.palette is None:
            return params
        if coding.on_device is None or coding.on_device[0] is not coding.labels:
            coding.on_device = coding.labels, StraightThrough(self._grids(coding), coding.palette, bands)
        return coding.on_device[1](params)

    def settle(self, coding: Coding, optimizer: SplatOptimizer) -> None:
        """Make the model that of its file, without primitives that can never be seen.

        SOG's positions lie between those that are outermost now: they are rounded anew, by less than a step. Raises
        ``DataError`` where every primitive has faded.
        """
        if coding.palette is None:
            return
        if not _keeps_bands(coding, optimizer):  # bytes were divided after the last step
            self._renew(coding, optimizer)
        opacities = self._grids(coding).logit_opacities.snap(optimizer.numpy("logit_opacities"))
        drop_faded(optimizer, sigmoid(opacities.astype(np.float64)))
        splats = optimizer.to_splats()
        coding.extents = Extents.of(splats, optimizer.curve is not None).numbers
        splats = self._grids(coding).snap(splats, coding.palette)
        arrays = {name: getattr(splats, name) for name in ("means", "log_scales", "quats", "logit_opacities")}
        for name, values in (arrays | {"sh_dc": splats.sh_coeffs[:, 0]} | bands_of(splats)).items():
            optimizer.assign(name, values.reshape(optimizer.numpy(name).shape))

    def _begin(
        self, coding: Coding, optimizer: SplatOptimizer, cameras: Sequence[DeviceCamera], options: RasterOptions
    ) -> None:
        """Of the ways to write a rotation down take the shortest: the moments of the others mean nothing then."""
        held = {"slopes": (SLOPES, CURVATURES), "cuts": PLANES, "shifts": (SHIFTS,)}
        for rows, groups in held.items():
            if any(len(optimizer.index_of(group)) for group in groups):
                raise ValueError(f"Quantiser: {self.format} holds no {rows}; begin with Splats.without_{rows}()")
        splats = nearest_to_identity(optimizer.to_splats())
        for name in ("log_scales", "quats"):
            optimizer.assign(name, getattr(splats, name))
            optimizer.reset_moments(name)
        found = weights(optimizer.params, cameras, options).total
        coding.weights = np.maximum(found, LEAST_WEIGHT)

    def _renew(self, coding: Coding, optimizer: SplatOptimizer) -> None:
        """Grids, and a round of the palette; a new one where primitives have other bands."""
        splats = optimizer.to_splats()
        coding.extents = Extents.of(splats, optimizer.curve is not None).numbers
        grids, share, weights = self._grids(coding), self._steps.entries, coding.weights
        if _keeps_bands(coding, optimizer):
            new = grids.palette(splats, share, weights, coding.palette)
        else:
            most = self.room.most_entries(splats) if self.room else MOST_ENTRIES
            new = grids.palette(splats, share, weights, most=most)
        coding.entries, coding.degrees, coding.labels = new.entries, new.degrees, new.labels

    @property
    def _steps(self) -> Steps:
        return self.steps or STEPS[self.format]

    def _grids(self, coding: Coding) -> FileGrids:
        return CODED[self.format](Extents.from_numbers(coding.extents), self._steps)


def _keeps_bands(coding: Coding, optimizer: SplatOptimizer) -> bool:
    """Whether primitives have the bands that the palette was made for."""
    return np.array_equal(coding.degrees[coding.labels], optimizer.sh_degrees)
