"""How much the colours of primitives weigh in a training view: from this follows what a change of a colour loses."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..engine.arrays import detached
from ..engine.parameters import device_array
from ..engine.view import prepare
from ..engine.walks.composite import composite_over
from ..engine.walks.squared_weights import composite_squared_weights
from .training_views import TrainingViews, mean_slope


def squared_weights(params: dict, views: TrainingViews, k: int) -> Any:
    """h = Σ w², w = α T, over the pixels of view ``k`` that count: [N] on the device.

    Seen through a tone curve, each pixel counts times the square of its slope there.

    Args:
        params: as in ``rasterize``, detached.
    """
    camera = views.cameras[k]
    view, weight = prepare(params, camera, views.options), views.mask(k)
    if views.curve:
        squared = np.square(mean_slope(views.curve, composite_over(view, views.background)))
        squared = squared.reshape(camera.height, camera.width)
        weight = squared if weight is None else squared * weight
    return composite_squared_weights(view, None if weight is None else detached(device_array(weight)))
