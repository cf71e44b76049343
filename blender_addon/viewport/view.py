"""A viewport as a camera: its pose and its intrinsics in pixels."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from mathutils import Matrix

from ..nodes.fields import PARALLEL
from ..nodes.tree import VIEW_MIRROR, VIEW_PROJECTION
from .region import seen_by


class View(NamedTuple):
    """Plain numbers, so that two views can be compared.

    ``center`` and ``size`` are of the picture: that of the region, or of the camera that it looks through.
    """

    matrix: tuple[tuple[float, ...], ...]  # from the view's space (looking along -z) to the world
    focal: tuple[float, float]  # pixels, as are the next two; of parallel rays pixels per unit
    center: tuple[float, float]
    size: tuple[float, float]
    parallel: bool = False


def view_of(space: Any, width: int, height: int, corners: np.ndarray | None = None) -> View:
    """The view of a region: ``space`` is its ``RegionView3D``.

    corners: [4, 3] in the world of the picture of the camera that it looks through.
    """
    camera = seen_by(space, width, height).of_picture(corners).camera
    left, top, right, bottom = camera.film or (0, 0, width, height)
    center, size = (camera.cx - left, camera.cy - top), (right - left, bottom - top)
    pose = space.view_matrix.inverted()
    return View(tuple(map(tuple, pose)), (camera.fx, camera.fy), center, size, not space.is_perspective)


def view_inputs(view: View) -> dict[str, Any]:
    """The inputs of the drawing modifier for that view."""
    location, rotation, scale = Matrix(view.matrix).decompose()
    numbers = {"View Focal": view.focal, "View Center": view.center, "View Size": view.size}
    return {
        "View": True,
        VIEW_PROJECTION: float(PARALLEL if view.parallel else 0),
        VIEW_MIRROR: -1.0 if scale.x < 0 else 1.0,  # as ``camera_pose`` has it
        "View Location": tuple(location),
        "View Rotation": tuple(rotation.to_euler()),
        **{name: (*pair, 0.0) for name, pair in numbers.items()},
    }
