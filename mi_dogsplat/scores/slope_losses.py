"""What slopes contribute to the training views, primitive by primitive: an estimate in the units of the other scores.

Without its slopes a primitive has one colour all over, and a picture changes by w (gx dx + gy dy), w = α T its weight
at a pixel and d the offset from its centre (``engine/slopes.py``). Where T is the same all over it and α is that of the
kernel alone, w² falls as exp(-dᵀ Σ'⁻¹ d), so that the mean of d dᵀ under w² is Σ'/2, and the energy of the change is

    Σ w² (g·d)² = h / 2 gᵀ Σ' g,   h = Σ w² over the pixels,

summed over channels and views. Of one primitive alone that is within 2 % of what its pictures change by
(``tests/scores/test_slope_losses.py``); what hides a side of it, or cuts one off, makes it an estimate, as DoG do.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import numpy as np

from ..engine.arrays import array_types
from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..engine.project import LOG2_E, project
from ..engine.view import prepare
from ..engine.walks.squared_weights import composite_squared_weights
from .counted import MaskOf, counted


def slope_losses(
    params: dict, cameras: Sequence[DeviceCamera], options: RasterOptions, masks: MaskOf | None = None
) -> np.ndarray:
    """[N] energy of the change of all views without the slopes of a primitive; 0 where it has none.

    Args:
        params: as in ``rasterize``, with slopes.
        cameras: all training views.
        masks: of these; None: all pixels count.
    """
    params = {name: dr.detach(value) for name, value in params.items()}
    total = dr.zeros(array_types().Double, dr.width(params["logit_opacities"]))
    for view, camera in enumerate(cameras if len(total) else ()):
        h = composite_squared_weights(prepare(params, camera, options), counted(masks, view))
        projection = project(params, camera, sh_degree=0)
        kernels, slopes = projection.kernels, projection.slopes or []
        square = 0
        for gx, gy in zip(slopes[:3], slopes[3:], strict=True):  # gᵀ Σ' g = |K⁻ᵀ g|² / 2 ln 2
            along = gx / kernels.ux
            across = (gy - kernels.uy * along) / kernels.vy
            square += dr.square(along) + dr.square(across)
        total += array_types().Double(dr.select(projection.visible & (h > 0), h * square * (0.25 * LOG2_E), 0))
        dr.eval(total)
    return total.numpy()
