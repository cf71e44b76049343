"""The AOVs once more, by brute force in float64 NumPy: all weights at all pixels as one table, then columns of it.

Arrays are [V, P]: the V visible primitives in depth order, P = H W pixels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .forward import MIN_T, depth_order, pixel_centres, walk
from .projection import MIN_ALPHA, project
from .quaternions import rotations

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats


def normals(splats: Splats, camera: Camera) -> np.ndarray:
    """[N, 3] shortest axes in world space, turned to the camera; of equal axes the first."""
    R = rotations(np.asarray(splats.quats, np.float64))
    axis = R[np.arange(len(R)), :, np.argmin(splats.log_scales, axis=1)]
    seen_from = np.asarray(splats.means, np.float64) - camera.position
    return np.where((axis * seen_from).sum(1, keepdims=True) > 0, -axis, axis)


def aovs(
    splats: Splats, camera: Camera, *, negative_transmittance: bool = True, **options
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Every AOV [H, W] (`normal` [H, W, 3]) and, [H, W], how clear the decisions of a pixel were.

    That is the smallest relative distance, over all primitives, of |alpha| to 1/255, of T to the end of the walk and to
    1/2, and of the largest weight to the next: a pixel where it is of the order of rounding may differ in float32.
    `options` go to `project`.
    """
    projection = project(splats, camera, **options)
    order, (x, y) = depth_order(projection), pixel_centres(0, 0, camera.width, camera.height)
    weights, behind, T = np.zeros((len(order), len(x))), np.ones((len(order), len(x))), np.ones(len(x))
    blended, clear = np.zeros(weights.shape, bool), np.full(len(x), np.inf)
    meetings = walk(projection, order, x, y, negative_transmittance=negative_transmittance)
    for row, meeting in enumerate(meetings):
        distances = [abs(meeting.difference) / MIN_ALPHA, meeting.T_past / MIN_T, meeting.T_past / 0.5]
        nearest = np.min([abs(distance - 1) for distance in distances], axis=0)
        clear = np.where(meeting.reached, np.minimum(clear, nearest), clear)
        weights[row], blended[row] = meeting.weight, meeting.goes_on & (meeting.alpha != 0)
        behind[row] = T = meeting.T_behind

    largest, following = np.sort(np.vstack([weights, np.zeros((2, len(x)))]), axis=0)[[-1, -2]]
    clear = np.where(largest > 0, np.minimum(clear, 1 - following / np.where(largest > 0, largest, 1)), clear)
    z, size = projection.depths[order], np.abs(weights)
    table = np.vstack([blended & (behind <= 0.5), np.ones(len(x), bool)])  # the last row: never
    median = np.append(z, 0)[table.argmax(0)]
    index = np.where(largest > 0, order[weights.argmax(0)] if len(order) else -1, -1)
    solid = 1 - T > 0
    normal = weights.T @ normals(splats, camera)[order]  # [P, 3]
    length = np.linalg.norm(normal, axis=1)
    planes = {
        "alpha": 1 - T,
        "depth": _ratio(z @ weights, 1 - T, solid),
        "median_depth": median,
        "normal": np.stack([_ratio(n, length, solid & (length > 0)) for n in normal.T], -1),
        "index": index,
        "count": blended.sum(0),
        "dog_share": _ratio(size[projection.dog[order]].sum(0), size.sum(0), blended.sum(0) > 0),
    }
    shape = camera.height, camera.width
    return {name: plane.reshape(*shape, *plane.shape[1:]) for name, plane in planes.items()}, clear.reshape(shape)


def _ratio(a: np.ndarray, b: np.ndarray, where: np.ndarray) -> np.ndarray:
    return np.where(where, a / np.where(where, b, 1), 0)
