"""Models of which one plane or two cut off some primitives."""

from dataclasses import replace
from typing import Any

import numpy as np
from mi_dogsplat.scene.row_groups import CUTS, RowGroup
from mi_dogsplat.scene.splats import Splats
from places import along_axes


def with_cuts(splats: Any, every: int = 2, first: int = 0) -> Splats:
    """The model in float32 with a random cut through each ``every``-th primitive from ``first`` on."""
    whole = Splats(**vars(splats))
    index = np.arange(first, whole.n_splats, every)
    normals = np.random.default_rng(7).normal(0, 6, (len(index), 3))  # planes some .4 standard deviations away
    return replace(whole, cut_index=index, cut_normals=normals)


def with_second_cuts(splats: Any, every: int = 2, first: int = 0) -> Splats:
    """The same, by the second plane; what the first one does stays."""
    before = Splats(**vars(splats))
    index = np.arange(first, before.n_splats, every)
    normals = np.random.default_rng(11).normal(0, 6, (len(index), 3))
    return replace(before, second_cut_index=index, second_cut_normals=normals)


def flattened(splats: Splats) -> Splats:
    """Primitives all but without a third axis, and planes that stand on the other two.

    In standard deviations along that axis means in float32 are known to some 1e-3.
    """
    of = splats.log_scales, splats.cut_normals, splats.second_cut_normals
    log_scales, normals, seconds = (values.copy() for values in of)
    log_scales[:, 2] = log_scales.min(axis=1) - 7
    normals[:, 2] = seconds[:, 2] = 0
    return replace(splats, log_scales=log_scales, cut_normals=normals, second_cut_normals=seconds)


def kept_shares(splats: Splats, points: np.ndarray, plane: RowGroup = CUTS) -> np.ndarray:
    """[C, P] float64 g, what a plane leaves of its primitives at points [C, P, 3] in the world."""
    (name,) = plane.names
    normals = getattr(splats, name).astype(np.float64)
    along = np.einsum("cpa,ca->cp", along_axes(splats, getattr(splats, plane.index), points), normals)
    return (1 + np.exp(-4)) / (1 + np.exp(-4 - along))
