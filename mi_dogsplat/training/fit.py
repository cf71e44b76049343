"""A model fitted to pictures from given cameras: the photographs of a data set, or renders of another model.

The steps of a training and nothing else: rows stay the same in number and order, and no strategy acts. For models that
stand in for others, as without DoG, or with fewer primitives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..datasets.dataset import Dataset, View, camera_extent, no_points
from ..engine.arrays import backward
from ..engine.options import RasterOptions
from ..engine.rasterize import rasterize
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.radiance import from_units_of_white, in_units_of_white
from ..scene.row_groups import BESIDE_COLORS
from ..scene.splats import Array, Splats
from ..support.wording import counted
from .images.photographs import Photographs
from .memory_budget import budget
from .optimizer.learning_rates import LearningRates, Refinement
from .optimizer.splat_optimizer import SplatOptimizer
from .quantisation.quantiser import Coding, Quantiser

GAINS = Refinement(start=0, gain=2.0, end_gain=0.1, means_gain=4.0)  # on the step sizes of 3DGS


@dataclass(frozen=True)
class Look:
    """How pictures show a model: drawn so, in front of a grey level.

    Where it is drawn as ``linear``, the model and the pictures hold linear radiance.
    """

    background: float = 0.0  # 0..1
    drawn: DrawnAs = DrawnAs()


def fit(
    splats: Splats,
    cameras: Sequence[Camera],
    pictures: Sequence[Array],
    steps: int,
    look: Look = Look(),
    gains: Refinement = GAINS,
    seed: int = 0,
    quantiser: Quantiser | None = None,
    after_step: Callable[[int, float], None] | None = None,
) -> Splats:
    """The model after ``steps`` steps of Adam towards the pictures; the same bits in every run on a CPU.

    Args:
        splats: the start, of N >= 1 primitives; rows of DoG, slopes, curvatures, cuts and shifts are fitted along.
        cameras, pictures: as many of each, [H, W, 3] display-referred or linear, seen in a random order, turn by turn.
        steps: of one picture each.
        look: how the pictures were drawn.
        gains: factors on the step sizes, as after pruning (``Refinement``), over ``steps``.
        seed: of the order.
        quantiser: the model is fitted, and returned, as its file will have it, without what can never be seen.
        after_step: called with the number of steps done and the loss, for which it waits.

    Needs a Mitsuba variant. Raises ``ValueError`` for no primitive, no picture, or pictures of other sizes than the
    cameras'.
    """
    drawn = look.drawn
    shown = _photographs(splats, _views(cameras, pictures, drawn.white if drawn.linear else None), look)
    rates = LearningRates(camera_extent(shown.originals), steps, refinement=gains)
    optimizer = SplatOptimizer(in_units_of_white(splats, drawn), rates, shown.curve)
    options = RasterOptions(sh_degree=splats.sh_degree, antialiased=drawn.antialiased)
    coding = Coding()
    if quantiser:
        optimizer.followers.append(lambda index, fresh: coding.rearrange(index))
    order: list[int] = []
    rng = np.random.default_rng(seed)
    for step in range(steps):
        optimizer.schedule(step)
        order = order or rng.permutation(len(shown)).tolist()
        params = optimizer.params
        if quantiser:
            quantiser.before_step(coding, optimizer, shown.cameras, options, step, steps)
            params = quantiser.params(coding, optimizer.params, optimizer.bands)
        loss = _learn_from(order.pop(), shown, params, options, step)
        optimizer.step()
        if after_step:
            after_step(step + 1, float(loss[0]))
    if quantiser:
        quantiser.settle(coding, optimizer)
    return from_units_of_white(optimizer.to_splats(), drawn)


def _learn_from(view: int, shown: Photographs, params: dict, options: RasterOptions, step: int) -> mi.Float:
    """Render, loss, backward; returns the loss."""
    planes = shown.over_background(rasterize(params, shown.cameras[view], options))
    _, loss, gradient = shown.compare(planes, view, step)
    backward(planes, [mi.Float(δ) for δ in gradient])
    return loss


def _photographs(splats: Splats, views: list[View], look: Look) -> Photographs:
    """The pictures as the loss sees them, as many of them prepared as there is memory for beside the model."""
    dataset = Dataset(Path(), views, [], *no_points(), has_alpha=False)
    groups = [group for group in BESIDE_COLORS if len(getattr(splats, group.index))]
    memory = budget(None, dataset, splats.sh_degree, groups=groups)
    keep_targets = memory is None or memory.keep_targets
    return Photographs(dataset, look.background, look.drawn.near_clip, keep_targets=keep_targets)


def _views(cameras: Sequence[Camera], pictures: Sequence[Array], white: float | None) -> list[View]:
    """Views of a data set for the pictures. Raises ``ValueError``, see ``fit``."""
    if len(cameras) != len(pictures) or not cameras:
        found = f"{counted(len(cameras), 'camera')}, {counted(len(pictures), 'picture')}"
        raise ValueError(f"fit: {found}; one of each is needed, or more")
    pairs = list(zip(cameras, pictures, strict=True))
    for camera, picture in pairs:
        if picture.shape != (camera.height, camera.width, 3):
            raise ValueError(f"fit: a picture {picture.shape} of a camera {camera.width}x{camera.height}")
    return [View(str(k), camera, picture, white=white) for k, (camera, picture) in enumerate(pairs)]
