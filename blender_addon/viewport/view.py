"""A viewport as a camera: its pose and its intrinsics in pixels."""

from __future__ import annotations

from typing import Any, NamedTuple

from mathutils import Matrix, Vector

from .projection import projection_of

FAR = 100.0  # half-widths of the picture: from there a camera sees as an orthographic view does


class View(NamedTuple):
    """Plain numbers, so that two views can be compared."""

    matrix: tuple[tuple[float, ...], ...]  # from the view's space (looking along -z) to the world
    focal: tuple[float, float]  # pixels, as are the next two
    center: tuple[float, float]
    size: tuple[float, float]


def view_of(space: Any, width: int, height: int) -> View:
    """The view of a region: ``space`` is its ``RegionView3D``."""
    pose, (focal, center) = space.view_matrix.inverted(), projection_of(space, width, height)
    if not space.is_perspective:
        distance = FAR / space.window_matrix[0][0]
        pose = pose.copy()
        pose.translation = space.view_location + pose.to_3x3() @ Vector((0, 0, distance))
        focal = focal[0] * distance, focal[1] * distance
    return View(tuple(map(tuple, pose)), focal, center, (width, height))


def view_inputs(view: View) -> dict[str, Any]:
    """The inputs of the drawing modifier for that view."""
    location, rotation, _ = Matrix(view.matrix).decompose()
    numbers = {"View Focal": view.focal, "View Center": view.center, "View Size": view.size}
    return {
        "View": True,
        "View Location": tuple(location),
        "View Rotation": tuple(rotation.to_euler()),
        **{name: (*pair, 0.0) for name, pair in numbers.items()},
    }
