"""Models of which some primitives stand elsewhere for each view."""

from dataclasses import replace
from typing import Any

import numpy as np
from mi_dogsplat import reference
from mi_dogsplat.scene.splats import Splats


def with_shifts(splats: Any, every: int = 2, first: int = 0) -> Splats:
    """The model in float32 with random shifts for each ``every``-th primitive from ``first`` on."""
    still = Splats(**vars(splats))
    index, rng = np.arange(first, still.n_splats, every), np.random.default_rng(17)
    shifts, views = rng.normal(0, 0.5, (len(index), 3, 3)), rng.uniform(-0.5, 0.5, (len(index), 3))
    return replace(still, shift_index=index, view_shifts=shifts, mean_views=views)


def places_seen(splats: Splats, views: np.ndarray) -> np.ndarray:
    """[V, P, 3] float64, where primitives with shifts stand as seen along unit vectors ``views`` [P, 3], by the words:
    so many standard deviations along each axis, for what the view has along each axis more than the mean view."""
    places = np.empty((splats.n_shifts, len(views), 3))
    for row, i in enumerate(splats.shift_index):
        axes = reference.rotations(splats.quats[i : i + 1].astype(np.float64))[0].T  # rows
        scales = np.exp(splats.log_scales[i].astype(np.float64))
        places[row] = splats.means[i]
        for b, along in enumerate(axes):
            more = views @ along - splats.mean_views[row, b]
            for a, axis in enumerate(axes):
                places[row] += np.outer(more, axis * scales[a] * splats.view_shifts[row, a, b])
    return places


def moves_seen(splats: Splats, points: np.ndarray) -> np.ndarray:
    """[V, P, 3] float64, by how many standard deviations along each axis primitives with shifts stand beside where
    they are stored, as seen from points [V, P, 3] in the world."""
    index = splats.shift_index
    views = splats.means[index].astype(np.float64)[:, None] - points
    axes = reference.rotations(splats.quats[index].astype(np.float64))  # columns
    own = np.einsum("vka,vpk->vpa", axes, views / np.linalg.norm(views, axis=-1, keepdims=True))
    more = own - splats.mean_views[:, None].astype(np.float64)
    return np.einsum("vab,vpb->vpa", splats.view_shifts.astype(np.float64), more)


def standing(splats: Splats, view: Any) -> Splats:
    """The model without shifts, primitives where they are seen along the unit vector ``view`` [3]."""
    still = splats.without_shifts()
    still.means[splats.shift_index] = places_seen(splats, np.reshape(view, (1, 3)))[:, 0]
    return still
