"""What slopes and curvatures contribute to the training views, primitive by primitive: estimates, in units of scores.

Without its slopes a primitive has one colour all over, and a picture changes by w (gx dx + gy dy), w = α T its weight
at a pixel and d the offset from its centre (``engine/slopes.py``). Where T is the same all over it and α is that of the
kernel alone, w² falls as exp(-dᵀ Σ'⁻¹ d), so that the mean of d dᵀ under w² is C = Σ'/2, and the energy of the change
is

    Σ w² (g·d)² = h gᵀ C g,   h = Σ w² over the pixels,

summed over channels and views. Without its curvatures it is as bright as on average, b (``Splats.without_curvatures``),
and a picture changes by w (dᵀ A d - b) in all three channels, q = dᵀ A d (``engine/curvatures.py``):

    Σ w² (dᵀ A d - b)² = h (2 tr (A C)² + (tr A C - b)²)

Of one primitive alone that is within 2 % of what its pictures change by (``tests/scores/test_slope_losses.py``); what
hides a side of it, or cuts one off, makes it an estimate, as DoG do.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from ..engine.arrays import array_types
from ..engine.curvatures import ROW
from ..engine.parameters import device_array
from ..engine.project import Projection, project
from ..engine.screen_kernels import LOG2_E
from ..scene.curvatures import mean_brightness
from .squared_weights import squared_weights
from .training_views import TrainingViews


def slope_losses(params: dict, views: TrainingViews) -> np.ndarray:
    """[N] energy of the change of all views without the slopes of a primitive; 0 where it has none.

    Args:
        params: as in ``rasterize``, with slopes.
    """

    def change(projection: Projection) -> Any:
        slopes: list = projection.slopes or []
        square: Any = 0
        for gradient in zip(slopes[:3], slopes[3:], strict=True):
            for v in _roots(projection):
                square += dr.square(_dot(gradient, v))
        return square

    return _losses(params, views, change)


def curvature_losses(params: dict, views: TrainingViews) -> np.ndarray:
    """The same without the curvatures of a primitive. Arguments as for ``slope_losses``."""
    average = np.zeros(dr.width(params["logit_opacities"]))
    rows = params["brightness_curvatures"].numpy().reshape(-1, ROW)
    index = params["curvature_index"].numpy()
    average[index] = mean_brightness(rows, params["log_scales"].numpy().reshape(-1, 3)[index])
    b = device_array(average)

    def change(projection: Projection) -> Any:
        assert projection.curvatures is not None
        qxx, qxy, qyy = projection.curvatures
        roots = _roots(projection)
        through = [(qxx * x + 0.5 * qxy * y, 0.5 * qxy * x + qyy * y) for x, y in roots]  # A v
        (m11, m12), (_, m22) = ([_dot(a, v) for v in roots] for a in through)
        squares = dr.square(m11) + 2 * dr.square(m12) + dr.square(m22)
        return 3 * (2 * squares + dr.square(m11 + m22 - b))

    return _losses(params, views, change)


def _losses(params: dict, views: TrainingViews, change: Callable[[Projection], Any]) -> np.ndarray:
    """[N] sums over the views of h times ``change``, the mean square of that of a colour."""
    params = dr.detach(params)
    total = dr.zeros(array_types().Double, dr.width(params["logit_opacities"]))
    for view, camera in enumerate(views.cameras if len(total) else ()):
        h = squared_weights(params, views, view)
        projection = project(params, camera, sh_degree=0)
        total += array_types().Double(dr.select(h > 0, h * change(projection), 0))
        dr.eval(total)
    return total.numpy()


def _roots(projection: Projection) -> list[tuple]:
    """Two vectors v with C = Σ v vᵀ: columns of K⁻¹ / 2 √ln 2, as dᵀ Σ'⁻¹ d = 2 ln 2 |K d|²."""
    k, unit = projection.kernels, 0.5 * LOG2_E**0.5
    x, y = unit * dr.rcp(k.ux), unit * dr.rcp(k.vy)
    return [(x, 0), (-k.uy * x * dr.rcp(k.vy), y)]


def _dot(a: tuple, b: tuple) -> Any:
    return a[0] * b[0] + a[1] * b[1]
