"""Models of which some primitives have a colour that varies over them."""

from dataclasses import replace
from typing import Any

import numpy as np
from mi_dogsplat.scene.splats import Splats
from places import along_axes


def with_slopes(splats: Any, every: int = 2, first: int = 0) -> Splats:
    """The model in float32 with random slopes for each ``every``-th primitive from ``first`` on."""
    whole = Splats(**vars(splats))
    index = np.arange(first, whole.n_splats, every)
    slopes = np.random.default_rng(5).normal(0, 0.3, (len(index), 3, 3))
    return replace(whole, slope_index=index, color_slopes=slopes)


def with_curvatures(splats: Any, every: int = 2, first: int = 0) -> Splats:
    """The model in float32 with random curvatures for each ``every``-th primitive from ``first`` on."""
    flat = Splats(**vars(splats))
    index = np.arange(first, flat.n_splats, every)
    curvatures = np.random.default_rng(13).normal(0, 0.2, (len(index), 6))
    return replace(flat, curvature_index=index, brightness_curvatures=curvatures)


def slope_colors(splats: Splats, points: np.ndarray) -> np.ndarray:
    """[S, P, 3] float64, what slopes add to the colour of their primitive at points [S, P, 3] in the world."""
    w = along_axes(splats, splats.slope_index, points)
    return np.einsum("spa,sac->spc", w, splats.color_slopes.astype(np.float64))


def curvature_brightness(splats: Splats, points: np.ndarray) -> np.ndarray:
    """[B, P] float64, by how much curvatures make their primitive brighter at points [B, P, 3] in the world."""
    x, y, z = np.moveaxis(along_axes(splats, splats.curvature_index, points), 2, 0)
    xx, yy, zz, xy, xz, yz = splats.brightness_curvatures.astype(np.float64).T[..., None]
    return (xx * x**2 + yy * y**2 + zz * z**2) / 2 + xy * x * y + xz * x * z + yz * y * z
