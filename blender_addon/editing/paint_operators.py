"""Painting on splats with Blender's own brushes: weights erase, vertex colours tint."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty

from ..nodes.modifier import add_edit_modifier, edit_modifiers, has_input, set_input
from ..nodes.paint import NAME as PAINT
from ..nodes.paint import paint_tree
from ..nodes.space import space_of
from ..objects.attributes import can_edit, is_splats
from ..objects.conventions import light_of
from .stand_in import build_stand_in, finish_painting, show_stand_in, stand_in_of

MODES = {"ERASE": "WEIGHT_PAINT", "TINT": "VERTEX_PAINT"}


class DOGSPLAT_OT_paint(bpy.types.Operator):
    """Paint the splats with Blender's brushes, on a stand-in that has faces: weights erase, colors tint"""

    bl_idname = "dogsplat.paint"
    bl_label = "Paint Splats"
    bl_options = {"REGISTER", "UNDO"}

    what: EnumProperty(name="What", items=(
        ("ERASE", "Erase", "Weight paint: splats with a weight above the threshold are hidden"),
        ("TINT", "Tint", "Vertex paint: colors are multiplied by the painted color"),
    ))  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """The active object holds splats, or is their stand-in."""
        return can_edit(painted_model(context.object))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Make the stand-in unless there is one, select it and enter the mode."""
        obj = painted_model(context.object)
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        stand_in = stand_in_of(obj)
        if stand_in is None:
            try:
                stand_in = build_stand_in(obj)
            except ValueError as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            modifiers = edit_modifiers(obj, PAINT) or [add_edit_modifier(obj, paint_tree(space_of(obj)), first=True)]
            set_input(modifiers[0], "Stand-In", stand_in)
            if has_input(modifiers[0], "Linear Light"):
                set_input(modifiers[0], "Linear Light", light_of(obj).linear)
            obj.update_tag()
        show_stand_in(obj, stand_in, context.view_layer)
        bpy.ops.object.select_all(action="DESELECT")
        stand_in.select_set(True)
        context.view_layer.objects.active = stand_in
        bpy.ops.object.mode_set(mode=MODES[self.what])
        return {"FINISHED"}


class DOGSPLAT_OT_finish_painting(bpy.types.Operator):
    """Store the painting with the splats, and remove the stand-in. You can continue painting later"""

    bl_idname = "dogsplat.finish_painting"
    bl_label = "Finish Painting"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There is a stand-in."""
        obj = painted_model(context.object)
        return can_edit(obj) and stand_in_of(obj) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Back to object mode, with the model selected."""
        obj = painted_model(context.object)
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        try:
            finish_painting(obj)
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        obj.select_set(True)
        context.view_layer.objects.active = obj
        return {"FINISHED"}


def painted_model(obj: bpy.types.Object | None) -> bpy.types.Object | None:
    """The model of a stand-in, or the object itself."""
    parent = obj.parent if obj is not None else None
    return parent if is_splats(parent) and stand_in_of(parent) == obj else obj
