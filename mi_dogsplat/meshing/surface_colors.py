"""Colours of points on a surface, from the views that see them."""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np

from ..scene.splats import Array
from .pixels import pixel_of
from .surface_views import SurfaceViews

UNSEEN = 0.5  # grey, for whoever needs a colour of what no view sees


def surface_colors(
    points: Array, views: SurfaceViews, tolerance: float, show: Callable[[], None], normals: Array | None = None
) -> Array:
    """[P, 3] display-referred, 0..1: the mean over the views in which a point is on the surface of its pixel; NaN where
    there is none.

    Args:
        points: [P, 3] world positions.
        tolerance: by how much farther or nearer than that surface a point may be, world units.
        show: called after each view.
        normals: [P, 3] of length 1. With them a view weighs as much as it shows of the point, squared: by the area
            that a piece of the surface has in its picture.
    """
    centre = points.mean(axis=0, dtype=np.float64) if len(points) else np.zeros(3)
    places = [_device(column) for column in (points - centre).T]  # far from the origin float32 loses its digits
    directions = None if normals is None else [_device(column) for column in normals.T]
    sums = [dr.zeros(mi.Float, len(points)) for _ in range(4)]
    dr.make_opaque(sums)
    for camera, depth, color in views:
        rotation = camera.w2c[:3, :3]
        shift = rotation @ centre + camera.w2c[:3, 3]
        numbers = [camera.fx, camera.fy, camera.cx, camera.cy, views.near, tolerance, *rotation.ravel(), *shift]
        if len(points):
            _add(
                sums, places, directions, [dr.opaque(mi.Float, float(number)) for number in numbers], _device(depth),
                [_device(color[..., k]) for k in range(3)], [dr.opaque(mi.UInt32, side) for side in depth.shape],
            )  # fmt: skip
        show()
    *colors, weights = (np.array(sum_, np.float64) for sum_ in sums)
    return np.stack(colors, axis=1) / np.where(weights > 0, weights, np.nan)[:, None]


def _device(values: Array) -> mi.Float:
    return mi.Float(np.ascontiguousarray(values, np.float32).ravel())


def _add(sums: list, places: list, normals: list | None, numbers: list, depth, color: list, size: list) -> None:
    """A view; a lane for each point."""
    *lens, near, tolerance = numbers[:6]
    pose = numbers[6:]
    x, y, z = (_along(pose[3 * k : 3 * k + 3], places) + pose[9 + k] for k in range(3))
    inside, pixel, inverse = pixel_of((x, y, z), lens, near, size)
    there = dr.gather(mi.Float, depth, pixel, inside)
    seen = inside & (there > 0) & (dr.abs(there - z) <= tolerance)
    weight = mi.Float(1)
    if normals is not None:
        toward = -sum(_along(pose[3 * k : 3 * k + 3], normals) * at for k, at in enumerate((x, y, z)))
        shown = dr.maximum(toward, mi.Float(0)) * dr.rsqrt(x * x + y * y + z * z) * inverse * inverse
        weight = shown * shown
    values = [dr.gather(mi.Float, plane, pixel, seen) for plane in color]
    seen &= dr.isfinite(values[0])
    weight = dr.select(seen, weight, 0)
    for k, value in enumerate(values):
        sums[k] += dr.select(seen, weight * value, 0)
    sums[3] += weight
    dr.eval(sums)


def _along(row: list, vector: list):
    """The scalar product of two lists of three."""
    return row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2]
