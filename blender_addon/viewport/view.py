"""A viewport as a camera: its pose and its intrinsics in pixels."""

from __future__ import annotations

from typing import Any, NamedTuple

from mathutils import Matrix

from ..nodes.fields import PARALLEL
from ..nodes.tree import VIEW_PROJECTION
from .projection import projection_of


class View(NamedTuple):
    """Plain numbers, so that two views can be compared."""

    matrix: tuple[tuple[float, ...], ...]  # from the view's space (looking along -z) to the world
    focal: tuple[float, float]  # pixels, as are the next two; of parallel rays pixels per unit
    center: tuple[float, float]
    size: tuple[float, float]
    parallel: bool = False


def view_of(space: Any, width: int, height: int) -> View:
    """The view of a region: ``space`` is its ``RegionView3D``."""
    pose, (focal, center) = space.view_matrix.inverted(), projection_of(space, width, height)
    return View(tuple(map(tuple, pose)), focal, center, (width, height), not space.is_perspective)


def view_inputs(view: View) -> dict[str, Any]:
    """The inputs of the drawing modifier for that view."""
    location, rotation, _ = Matrix(view.matrix).decompose()
    numbers = {"View Focal": view.focal, "View Center": view.center, "View Size": view.size}
    return {
        "View": True,
        VIEW_PROJECTION: float(PARALLEL if view.parallel else 0),
        "View Location": tuple(location),
        "View Rotation": tuple(rotation.to_euler()),
        **{name: (*pair, 0.0) for name, pair in numbers.items()},
    }
