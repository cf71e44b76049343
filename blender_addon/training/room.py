"""Where there is room for a camera between the things of an interior."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector

from .rig import spiral

WAYS = 14  # directions that are looked into from a place
CLEARANCE = 0.05  # to the nearest surface, of the room's diagonal
SMALLER = 0.5  # than the room, of its diagonal: a thing that a camera might be in


def is_free(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, place: np.ndarray, low: np.ndarray, high: np.ndarray
) -> bool:
    """Whether a camera at ``place`` [3] is neither close to a surface nor in a thing of a room from ``low`` [3] to
    ``high``: all that it sees would be one object, smaller than the room."""
    size = float(np.linalg.norm(high - low))
    hits = [scene.ray_cast(depsgraph, Vector(place), Vector(way)) for way in spiral(WAYS, (-90, 90))]
    reached = [(spot, obj) for hit, spot, _, _, obj, _ in hits if hit]
    if any((spot - Vector(place)).length < CLEARANCE * size for spot, _ in reached):
        return False
    around = {obj.name_full: obj for _, obj in reached}
    if len(reached) < WAYS or len(around) > 1:
        return True
    (only,) = around.values()
    corners = np.array([only.matrix_world @ Vector(corner) for corner in only.bound_box])
    return float(np.linalg.norm(np.ptp(corners, axis=0))) > SMALLER * size
