"""How much primitives weigh in the training views: the sums from which many scores in the literature are made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import drjit as dr
import numpy as np

from ..engine.arrays import detached
from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..engine.parameters import device_array
from ..engine.view import prepare
from ..engine.walks.aovs import composite_aovs
from ..engine.walks.weights import composite_weights
from .training_views import whole


@dataclass
class Weights:
    """Over all views and the pixels that count in which a primitive is blended, [N] float64 each."""

    total: np.ndarray  # Σ α T
    transmittance: np.ndarray  # Σ T
    pixels: np.ndarray  # their number
    weighted: np.ndarray  # Σ e α T
    largest: np.ndarray  # max α T
    dominates: np.ndarray  # [N] bool, it has the largest α T of some pixel


def weights(
    params: dict,
    cameras: Sequence[DeviceCamera],
    options: RasterOptions,
    planes: Sequence[np.ndarray] | None = None,
    mask: Callable[[int], np.ndarray | None] = whole,
) -> Weights:
    """Walk through all views.

    Args:
        params: as in ``rasterize``.
        cameras: the views.
        planes: e of each view, [H, W]; None: 1 everywhere.
        mask: of a view by its place among the cameras, as ``TrainingViews`` has it.
    """
    n = dr.width(params["logit_opacities"])
    params = dr.detach(params)
    sums = np.zeros((4, n))
    largest, dominates = np.zeros(n), np.zeros(n, bool)
    for k, camera in enumerate(cameras if n else []):
        view = prepare(params, camera, options)
        plane = np.ones((camera.height, camera.width)) if planes is None else planes[k]
        counts = mask(k)
        on_device = None if counts is None else detached(device_array(counts))
        columns, largest_bits = composite_weights(view, detached(device_array(plane)), on_device)
        sums += np.stack([column.numpy() for column in columns])
        largest = np.maximum(largest, largest_bits.numpy().view(np.float32))
        index = composite_aovs(view, ("index",))[0].numpy()
        of_pixels = index if counts is None else index[np.ravel(counts) > 0]
        dominates[of_pixels[of_pixels >= 0].astype(np.int64)] = True
    total, transmittance, pixels, weighted = sums
    return Weights(total, transmittance, pixels, weighted, largest, dominates)
