"""Models of which some primitives have a colour that varies over them."""

from dataclasses import replace
from typing import Any

import numpy as np
from mi_dogsplat import reference
from mi_dogsplat.scene.splats import Splats


def with_slopes(splats: Any, every: int = 2, first: int = 0) -> Splats:
    """The model in float32 with random slopes for each ``every``-th primitive from ``first`` on."""
    whole = Splats(**vars(splats))
    index = np.arange(first, whole.n_splats, every)
    slopes = np.random.default_rng(5).normal(0, 0.3, (len(index), 3, 3))
    return replace(whole, slope_index=index, color_slopes=slopes)


def slope_colors(splats: Splats, points: np.ndarray) -> np.ndarray:
    """[S, P, 3] float64, what slopes add to the colour of their primitive at points [S, P, 3] in the world."""
    at = splats.slope_index
    scales = np.exp(splats.log_scales[at].astype(np.float64))
    axes = reference.rotations(splats.quats[at].astype(np.float64))  # [S, 3, 3], columns
    w = np.einsum("ska,spk->spa", axes, points - splats.means[at].astype(np.float64)[:, None]) / scales[:, None]
    return np.einsum("spa,sac->spc", w, splats.color_slopes.astype(np.float64))


def points_in(splats: Splats, index: np.ndarray | None = None) -> np.ndarray:
    """[M, 7, 3] places in the world within some standard deviations of each primitive of ``index`` [M].

    Default: of each with slopes.
    """
    index = splats.slope_index if index is None else index
    w = np.random.default_rng(6).normal(size=(len(index), 7, 3))
    turns, scales = reference.rotations(splats.quats[index].astype(np.float64)), splats.scales[index].astype(np.float64)
    return splats.means[index].astype(np.float64)[:, None] + np.einsum("mka,mpa->mpk", turns * scales[:, None], w)
