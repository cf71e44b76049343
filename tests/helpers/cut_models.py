"""Models of which a plane cuts off some primitives."""

from dataclasses import replace
from typing import Any

import numpy as np
from mi_dogsplat import reference
from mi_dogsplat.scene.splats import Splats


def with_cuts(splats: Any, every: int = 2, first: int = 0) -> Splats:
    """The model in float32 with a random cut through each ``every``-th primitive from ``first`` on."""
    whole = Splats(**vars(splats))
    index = np.arange(first, whole.n_splats, every)
    normals = np.random.default_rng(7).normal(0, 6, (len(index), 3))  # planes some .4 standard deviations away
    return replace(whole, cut_index=index, cut_normals=normals)


def kept_shares(splats: Splats, points: np.ndarray) -> np.ndarray:
    """[C, P] float64 g, what a cut leaves of its primitive at points [C, P, 3] in the world."""
    at = splats.cut_index
    scales = np.exp(splats.log_scales[at].astype(np.float64))
    axes = reference.rotations(splats.quats[at].astype(np.float64))  # [C, 3, 3], columns
    w = np.einsum("cka,cpk->cpa", axes, points - splats.means[at].astype(np.float64)[:, None]) / scales[:, None]
    along = np.einsum("cpa,ca->cp", w, splats.cut_normals.astype(np.float64))
    return (1 + np.exp(-4)) / (1 + np.exp(-4 - along))
