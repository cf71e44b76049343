"""The camera that a region of a viewport looks through, and where its picture is."""

from __future__ import annotations

import bpy
import numpy as np


def looked_through(context: bpy.types.Context) -> bpy.types.Object | None:
    """The object that the region of a context looks through: a camera, or any other."""
    return context.space_data.camera if context.region_data.view_perspective == "CAMERA" else None


def corners_of(scene: bpy.types.Scene, camera: bpy.types.Object) -> np.ndarray | None:
    """[4, 3] of its picture, in the world; None of what is no camera, of which nobody knows a picture."""
    if camera.type != "CAMERA":
        return None
    pose = camera.matrix_world.normalized()
    return np.array([pose @ corner for corner in camera.data.view_frame(scene=scene)])
