"""Edits as users make them: a place of an object, crops, strokes of a brush, and what all that leaves."""

import bpy
import numpy as np
from mathutils import Euler, Matrix

from blender_addon.evaluated.edited import edited_model
from blender_addon.files.model import Model
from blender_addon.nodes.modifier import edit_modifiers
from blender_addon.nodes.paint import CORNERS

PLACED = Matrix.Translation((0.3, -1.0, 2.0)) @ Euler((0.3, 0.2, 1.0)).to_matrix().to_4x4() @ Matrix.Scale(1.7, 4)
TURN = Matrix.Rotation(0.8, 4, (1, 2, -1)) @ Matrix.Scale(1.7, 4)


def shown(obj: bpy.types.Object) -> Model:
    """What the modifiers leave now."""
    obj.update_tag()
    return edited_model(obj, bpy.context.evaluated_depsgraph_get())


def cropped(obj: bpy.types.Object, shape: str, **options) -> tuple[bpy.types.Modifier, bpy.types.Object]:
    """(modifier, object) of a new crop, made smaller, so that there is something on both sides."""
    assert bpy.ops.dogsplat.add_crop(shape=shape, **options) == {"FINISHED"}
    modifier = edit_modifiers(obj)[-1]
    target = next(other for other in bpy.context.selected_objects if other != obj)
    target.scale *= 0.6
    bpy.context.view_layer.update()
    return modifier, target


def local(obj: bpy.types.Object, target: bpy.types.Object, points: np.ndarray) -> np.ndarray:
    """Points of a model as the crop object sees them."""
    matrix = np.linalg.inv(np.array(target.matrix_world, np.float64)) @ np.array(obj.matrix_world)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def paint(stand_in: bpy.types.Object, rows: np.ndarray, weight=None, color=None) -> None:
    """What a stroke over these splats leaves."""
    corners = (rows[:, None] * CORNERS + np.arange(CORNERS)).ravel()
    if weight is not None:
        stand_in.vertex_groups["Erase"].add(corners.tolist(), weight, "REPLACE")
    if color is not None:
        for corner in corners:
            stand_in.data.attributes["Tint"].data[corner].color = color
    stand_in.data.update()
    stand_in.update_tag()


def only_an_instance(scene: bpy.types.Scene, obj: bpy.types.Object) -> bpy.types.Object:
    """The empty that shows a model, which a collection has and the scene has not; it is the active object."""
    collection = bpy.data.collections.new("models")
    scene.collection.objects.unlink(obj)
    collection.objects.link(obj)
    collection.instance_offset = 0.5, -1, 2
    maker = bpy.data.objects.new("instance", None)
    maker.instance_type, maker.instance_collection, maker.matrix_world = "COLLECTION", collection, PLACED
    scene.collection.objects.link(maker)
    bpy.context.view_layer.objects.active = maker
    bpy.context.view_layer.update()
    return maker
