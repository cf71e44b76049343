"""Linear pictures that are seen through a tone curve: a change of a pixel shows times the slope of the curve there.

So the energy of a change, a sum of squares over pixels, is that of the linear picture with a weight on each pixel, the
square of the slope: linearised, as the scores are (``ScoreRule.curve``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import drjit as dr
import numpy as np

from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..engine.view import prepare
from ..engine.walks.composite import composite_over
from .counted import WeightOf


class Curve(Protocol):
    """A tone curve, ``training/images/tone_curve.py``."""

    def slope(self, x: Any) -> Any:
        """Its derivative."""
        ...


def mean_slope(curve: Curve, image: list) -> np.ndarray:
    """[H*W] of a curve at a picture of three planes [H*W], the mean over these."""
    return np.mean([curve.slope(plane).numpy() for plane in image], axis=0)


def toned(
    curve: Curve,
    params: dict,
    cameras: Sequence[DeviceCamera],
    options: RasterOptions,
    background: float,
    masks: WeightOf | None = None,
) -> WeightOf:
    """What a squared change of a pixel counts, of a model as it is now; a view is rendered whenever it is asked for.

    Args:
        curve: through which the pictures are seen.
        params: as in ``rasterize``.
        cameras: all training views.
        options: specialisation of the kernels.
        background: grey level behind the primitives.
        masks: of the views; None: all pixels count.
    """
    params = dr.detach(params)

    def weight(view: int) -> np.ndarray:
        camera = cameras[view]
        image = composite_over(prepare(params, camera, options), background)
        squared = np.square(mean_slope(curve, image)).reshape(camera.height, camera.width)
        mask = masks(view) if masks else None
        return squared if mask is None else squared * mask

    return weight
