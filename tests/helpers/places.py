"""Places in the primitives of a model: in the world, and in standard deviations along their own axes."""

import numpy as np
from mi_dogsplat import reference
from mi_dogsplat.scene.splats import Splats


def points_in(splats: Splats, index: np.ndarray | None = None) -> np.ndarray:
    """[M, 7, 3] places in the world within some standard deviations of each primitive of ``index`` [M].

    Default: of each with slopes.
    """
    index = splats.slope_index if index is None else index
    w = np.random.default_rng(6).normal(size=(len(index), 7, 3))
    turns, scales = reference.rotations(splats.quats[index].astype(np.float64)), splats.scales[index].astype(np.float64)
    return splats.means[index].astype(np.float64)[:, None] + np.einsum("mka,mpa->mpk", turns * scales[:, None], w)


def along_axes(splats: Splats, index: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[M, P, 3] float64: points [M, P, 3] of the world, as primitive ``index`` [M] of each row has them."""
    scales = np.exp(splats.log_scales[index].astype(np.float64))
    axes = reference.rotations(splats.quats[index].astype(np.float64))  # [M, 3, 3], columns
    offsets = points - splats.means[index].astype(np.float64)[:, None]
    return np.einsum("mka,mpk->mpa", axes, offsets) / scales[:, None]
