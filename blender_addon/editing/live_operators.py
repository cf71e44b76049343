"""Edits that stay live: a crop by an object, and sliders, as modifiers in front of the one that draws."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty
from mathutils import Matrix, Vector

from ..nodes.crop import SHAPES, crop_tree
from ..nodes.limits import limits_tree
from ..nodes.modifier import add_edit_modifier, set_input
from ..objects.attributes import can_edit, is_splats
from ..objects.columns import get_column
from ..translations import OWN

SHARE = 0.96  # of the splats along each axis that a new crop object holds: floaters are outside


class DOGSPLAT_OT_add_crop(bpy.types.Operator):
    """Keep the splats inside of an object: an empty, or a mesh as a wire frame that renders do not show."""

    bl_idname = "dogsplat.add_crop"
    bl_description = (
        "Show only the splats inside a new object, which you can move and animate; nothing is deleted. Mesh takes "
        "another selected mesh, and makes it a wire frame that renders do not show"
    )
    bl_label = "Add Crop"
    bl_options = {"REGISTER", "UNDO"}

    shape: EnumProperty(name="Shape", items=[(name.upper(), name, "") for name in SHAPES], translation_context=OWN)
    invert: BoolProperty(name="Invert", description="Show what is outside instead")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """The active object holds splats."""
        return context.mode == "OBJECT" and can_edit(context.object)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """The new object is as large as most of the model, and selected; the model stays the active object."""
        obj = context.object
        others = [other for other in context.selected_objects if other.type == "MESH" and not is_splats(other)]
        if self.shape == "MESH" and others:
            target = others[0]
        else:
            target = _crop_object(obj, self.shape)
            for collection in obj.users_collection:
                collection.objects.link(target)
        target.hide_render = True
        target.display_type = "WIRE"
        modifier = add_edit_modifier(obj, crop_tree())
        set_input(modifier, "Shape", self.shape.capitalize())
        set_input(modifier, "Object", target)
        set_input(modifier, "Invert", self.invert)
        obj.update_tag()
        for other in context.selected_objects:
            other.select_set(other == obj)
        target.select_set(True)
        return {"FINISHED"}


def _crop_object(obj: bpy.types.Object, shape: str) -> bpy.types.Object:
    """An empty, or a cube for a mesh, around most of the splats, along the axes of the model."""
    name = f"{obj.name} crop"
    if shape == "MESH":
        mesh = bpy.data.meshes.new(name)
        corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
        faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        mesh.from_pydata(corners, [], faces)
        target = bpy.data.objects.new(name, mesh)
    else:
        target = bpy.data.objects.new(name, None)
        target.empty_display_type, target.empty_display_size = {"BOX": "CUBE", "SPHERE": "SPHERE"}[shape], 1.0
    positions = get_column(obj.data, "position", 3)
    if not len(positions):  # a model that is not there any more, but for its object
        positions = np.array([(-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)])
    low, high = np.quantile(positions, [(1 - SHARE) / 2, (1 + SHARE) / 2], axis=0)
    half = np.maximum((high - low) / 2, 1e-6)
    if shape == "SPHERE":
        half[:] = np.linalg.norm(half)
    target.matrix_world = (
        obj.matrix_world @ Matrix.Translation(Vector((low + high) / 2)) @ Matrix.Diagonal((*half.tolist(), 1.0))
    )
    return target


class DOGSPLAT_OT_add_limits(bpy.types.Operator):
    """Limit the opacity, size and number of the splats that are shown; nothing is deleted"""

    bl_idname = "dogsplat.add_limits"
    bl_label = "Add Limits"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """The active object holds splats."""
        return context.mode == "OBJECT" and can_edit(context.object)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """After crops that are there, so that a count is of what they leave."""
        add_edit_modifier(context.object, limits_tree())
        return {"FINISHED"}
