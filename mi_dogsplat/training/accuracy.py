"""How far the model in training is from the photographs."""

from __future__ import annotations

from typing import Protocol

import drjit as dr
import numpy as np

from ..datasets import Dataset
from ..engine.arrays import array_types
from ..measure.metrics import flip, psnr
from ..render.picture import photograph, seen_as
from .strategy.strategy import Training


class Measured(Training, Protocol):
    """A trainer, with what it does not show to its strategies."""

    dataset: Dataset
    background: float


def training_l1(trainer: Training) -> float:
    """Mean L1 over all training views, of what the loss sees: display values clamped to [0, 1], or what its curve makes
    of radiance, which has no such end."""
    photographs = trainer.photographs
    params = dr.detach(trainer.optimizer.params)
    total = dr.opaque(array_types().Float, 0)
    photographs.keep_background()
    for view in range(len(photographs)):
        total += photographs.l1(trainer.render(params, view)[0], view)
        dr.eval(total)
    return float(total[0]) / len(photographs)


def errors_of_test_views(trainer: Measured, with_flip: bool = False) -> dict[str, float]:
    """Means over the test views: ``test_psnr``, and ``test_flip``, which takes longer; of views that masks leave."""
    errors: dict[str, list[float]] = {"test_psnr": []}
    masks = trainer.photographs.mask_folder
    for view in trainer.dataset.test:
        mask = masks.of(view) if masks else None
        if mask is not None and not mask.any():
            continue
        view = view.in_memory()
        image, truth = seen_as(trainer.picture(view), view), photograph(view, trainer.background)
        errors["test_psnr"].append(psnr(image, truth, mask))
        if with_flip:
            errors.setdefault("test_flip", []).append(flip(image, truth, mask)[0])
    return {name: float(np.mean(values)) for name, values in errors.items() if values}
