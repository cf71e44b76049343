"""Edits made real: the splats that the modifiers hide are deleted."""

from __future__ import annotations

import bpy

from ..files.errors import told
from ..nodes.modifier import edit_modifiers
from ..objects.attributes import can_edit
from .applied import applied_meshes, applied_modifiers
from .stand_in import finish_painting


def apply_edits(objects: list[bpy.types.Object], depsgraph: bpy.types.Depsgraph) -> int:
    """Replace the splats of objects by those that are shown, and remove what edited them; how many went.

    Every enabled modifier in front of the drawing one is applied, ours or not. Other objects keep data that they share.
    Raises ``ValueError`` where nothing is left of one, with all of them as they were.
    """
    meshes, before = applied_meshes(objects, depsgraph), [len(obj.data.vertices) for obj in objects]
    for obj in objects:
        finish_painting(obj)
    for obj, mesh in zip(objects, meshes, strict=True):
        _replace(obj, mesh)
    return sum(before) - sum(len(mesh.vertices) for mesh in meshes)


def _replace(obj: bpy.types.Object, mesh: bpy.types.Mesh) -> None:
    """Give an object a mesh in which its edits are applied."""
    old, name = obj.data, obj.data.name
    obj.data = mesh
    for modifier in applied_modifiers(obj):
        obj.modifiers.remove(modifier)
    if not old.users:
        bpy.data.meshes.remove(old)
    mesh.name = name


class DOGSPLAT_OT_apply_edits(bpy.types.Operator):
    """Delete the splats that crop, limits and painting hide, and make tints part of the colors"""

    bl_idname = "dogsplat.apply_edits"
    bl_label = "Apply Edits"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """A selected model is edited by a modifier of ours."""
        return context.mode == "OBJECT" and any(can_edit(o) and edit_modifiers(o) for o in context.selected_objects)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """All selected models, or after an error none."""
        objects = [obj for obj in context.selected_objects if can_edit(obj) and edit_modifiers(obj)]
        try:
            gone = apply_edits(objects, context.evaluated_depsgraph_get())
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, told("{count:,} splats deleted", count=gone))
        return {"FINISHED"}
