"""Models of which some primitives stand elsewhere in each view, and where they do."""

from dataclasses import replace
from typing import Any

import numpy as np
from mi_dogsplat import reference
from mi_dogsplat.scene.splats import Splats


def with_shifts(splats: Any, every: int = 2, first: int = 0) -> Splats:
    """The model in float32 with a random shift of each ``every``-th primitive from ``first`` on."""
    still = Splats(**vars(splats))
    index, rng = np.arange(first, still.n_splats, every), np.random.default_rng(17)
    shifts = rng.normal(0, 0.5, (len(index), 3, 3))
    return replace(still, shift_index=index, view_shifts=shifts, mean_views=rng.uniform(-0.5, 0.5, (len(index), 3)))


def standing(splats: Splats, view: Any) -> Splats:
    """The model without shifts, each primitive where it is seen along the unit vector ``view`` [3]."""
    still, i = splats.without_shifts(), splats.shift_index
    R, scales = reference.rotations(splats.quats[i].astype(float)), np.exp(splats.log_scales[i].astype(float))
    away = R.swapaxes(1, 2) @ np.asarray(view, float) - splats.mean_views
    moves = scales * (splats.view_shifts @ away[:, :, None])[:, :, 0]
    still.means[i] += (R @ moves[:, :, None])[:, :, 0]
    return still
