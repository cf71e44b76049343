"""The colours of photographs, as the surface in them has them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..datasets.dataset import View
from ..datasets.images import straight_color
from ..datasets.masks import Masks
from ..export.refine import CLIPPED
from ..scene.appearance import Appearance
from ..scene.drawing import DrawnAs
from ..scene.splats import Array
from ..support.srgb import displayed
from .surface_views import LEAST_ALPHA


def photograph_colors(
    views: Sequence[View], drawn: DrawnAs, masks: Masks | None = None, appearance: Appearance | None = None
) -> Callable[[int, Array], Array]:
    """A function that returns the colours of a view, [H, W, 3] display-referred, NaN where its mask is black or its
    image transparent; by its number, and by the colours [H, W, 3] that the model has there.

    Linear radiance is exposed by the white of a linear model, or else by that of the view. ``appearance``: what the
    cameras did to display-referred photographs, and the model is without. It is taken out of them; where one is at its
    limit, and the model is brighter, the model says what was lost.
    """
    learned = None if drawn.linear else appearance

    def colors(k: int, own: Array) -> Array:
        view = views[k]
        image, mask = view.image, masks.of(view) if masks else None
        known = np.ones(image.shape[:2], bool) if mask is None else mask > 0
        color = image[..., :3]
        if image.shape[2] == 4:
            known &= image[..., 3] >= LEAST_ALPHA
            color = straight_color(color, image[..., 3:])
        if view.white is not None:
            color = displayed(color, drawn.white if drawn.linear else view.white)
        elif learned:
            without = learned.taken_out(color, view.camera, view.name)
            color = np.where(color >= CLIPPED, np.maximum(without, own), without)
        return np.where(known[..., None], color, np.nan)

    return colors
