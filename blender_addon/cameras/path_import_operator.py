"""File > Import > DoG Splat Camera Path: the key frames of a film as one animated camera."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ImportHelper
from mathutils import Matrix, Vector

from ..files.errors import FileError, readable, told
from ..objects.place import place_of
from ..translations import OWN
from .objects import build_camera, look_through, picture_size
from .path_file import PathKey, read_path


class DOGSPLAT_OT_import_path(bpy.types.Operator, ImportHelper):
    """Import the key frames of dogsplat film as an animated camera"""

    bl_idname = "import_scene.dogsplat_path"
    bl_label = "Import DoG Splat Camera Path"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})
    use_range: BoolProperty(
        name="Set Frame Range",
        default=True,
        description="Set the first and last frame of the scene to those of the path",
        translation_context=OWN,
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """A camera that follows the active model of splats, as it is placed now; after an error, none."""
        scene, path = context.scene, Path(bpy.path.abspath(self.filepath))
        place = place_of(context.view_layer.objects.active)
        matrix = place.now(context) if place else Matrix.Identity(4)
        upright = matrix.to_3x3().inverted_safe() @ Vector((0, 0, 1))  # of Blender, in the coordinates of the file
        try:
            keys = read_path(path, *picture_size(scene.render), np.array(upright))
        except FileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        obj = build_camera(scene.collection, keys[0].camera, matrix, str(path), False)
        obj.name = obj.data.name = readable(path.stem)
        rate, start = scene.render.fps / scene.render.fps_base, scene.frame_start
        for key in keys:
            _insert(obj, key, matrix, start + (key.time - keys[0].time) * rate)
        if keys[0].sized:
            look_through(scene, obj)
        scene.camera = obj
        if self.use_range:
            scene.frame_end = max(start, round(start + (keys[-1].time - keys[0].time) * rate))
        scene.frame_set(scene.frame_current, subframe=scene.frame_subframe)
        self.report({"INFO"}, told("{count} key frames imported", count=len(keys)))
        return {"FINISHED"}


def _insert(obj: bpy.types.Object, key: PathKey, matrix: Matrix, frame: float) -> None:
    """Set the camera to a key, by the way that sets every imported camera, and remember it at a frame."""
    staged = build_camera(bpy.context.scene.collection, key.camera, matrix, "", False)
    obj.rotation_mode = "QUATERNION"
    turn = staged.matrix_world.to_quaternion()
    turn.make_compatible(obj.rotation_quaternion)
    obj.location, obj.rotation_quaternion = staged.matrix_world.to_translation(), turn
    for name in ("lens", "shift_x", "shift_y"):
        setattr(obj.data, name, getattr(staged.data, name))
        obj.data.keyframe_insert(name, frame=frame)
    for name in ("location", "rotation_quaternion"):
        obj.keyframe_insert(name, frame=frame)
    bpy.data.cameras.remove(staged.data)  # and its object
