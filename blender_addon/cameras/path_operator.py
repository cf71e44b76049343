"""File > Export > DoG Splat Camera Path: the animated camera as key frames for ``dogsplat film --path``."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..files.errors import told
from ..files.linear_map import is_similarity
from ..files.transform import mean_scale
from ..files.whole import write_whole
from ..objects.place import Place, place_of
from .objects import pinhole_numbers

PINHOLE = ("fx", "fy", "cx", "cy", "width", "height")


class DOGSPLAT_OT_export_path(bpy.types.Operator, ExportHelper):
    """Export the scene's camera, frame by frame, in the coordinates of the model: for dogsplat film --path"""

    bl_idname = "export_scene.dogsplat_path"
    bl_label = "Export DoG Splat Camera Path"
    bl_options = {"PRESET"}

    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})
    step: IntProperty(name="Step", default=1, min=1, soft_max=24, description="Frames from one key to the next")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There is a camera to follow."""
        return context.scene.camera is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """One key for each step of the scene's frames, the last one too; the scene is left at its frame."""
        scene, place = context.scene, _place(context)
        last, before = scene.frame_end, (scene.frame_current, scene.frame_subframe)
        frames = sorted({*range(scene.frame_start, last + 1, self.step), last})
        rate = scene.render.fps / scene.render.fps_base
        try:
            keys = []
            with place.known(context) if place else nullcontext():
                for frame in frames:
                    scene.frame_set(frame)
                    matrix = place.matrix if place else np.eye(4)
                    keys.append({"time": (frame - frames[0]) / rate, **_key(scene, matrix)})
            write_whole(Path(bpy.path.abspath(self.filepath)), [(json.dumps({"keys": keys}, indent=1) + "\n").encode()])
        except ValueError as error:  # FileError too
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            scene.frame_set(before[0], subframe=before[1])
        self.report({"INFO"}, told("{count} key frames exported", count=len(keys)))
        return {"FINISHED"}


def _place(context: bpy.types.Context) -> Place | None:
    """Of the splats that the path is for: the active ones, else the only ones of the scene, or the only instance."""
    if (active := place_of(context.view_layer.objects.active)) is not None:
        return active
    found = [place for obj in context.scene.objects if (place := place_of(obj)) is not None]
    found = [place for place in found if place.maker is None] or found
    return found[0] if len(found) == 1 else None


def _key(scene: bpy.types.Scene, matrix: np.ndarray) -> dict[str, Any]:
    """The camera as in a camera file; ``matrix`` [4, 4] goes from coordinates of the model to Blender's."""
    camera = pinhole_numbers(scene, scene.camera)
    if not is_similarity(matrix[:3, :3]):
        problem = "the model is mirrored, sheared or scaled unevenly: no camera sees that; apply its transform"
        raise ValueError(told(problem))
    w2c = camera.w2c @ matrix
    w2c[:3] /= mean_scale(matrix[:3, :3])
    return {"w2c": w2c.tolist(), **{name: getattr(camera, name) for name in PINHOLE}}
