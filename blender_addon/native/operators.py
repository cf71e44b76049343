"""Convert to Native, and Convert to DoG Splat."""

from __future__ import annotations

from collections.abc import Callable

import bpy
from bpy.props import BoolProperty

from ..editing.applied import applied_mesh
from ..editing.stand_in import finish_painting
from ..files.errors import told
from ..objects.attributes import can_edit, can_edit_native, read_attributes
from ..objects.cloud import read_cloud
from ..objects.feature import is_available
from ..preferences import command_of
from .bake import baked
from .convert import dog_object, drawing_of, native_object, remove_object, replace_object

KEEP = "Keep the object that is converted in the file, hidden"


class Conversion:
    """All selected objects that can be converted, or after an error none."""

    bl_options = {"REGISTER", "UNDO"}

    def convert(self, context: bpy.types.Context, objects: list[bpy.types.Object], make: Callable) -> set[str]:
        """Replace each object by what ``make`` makes of it; the active one stays active."""
        active, made = context.view_layer.objects.active, []
        try:
            for obj in objects:
                made.append(make(obj))
        except ValueError as error:
            for new in made:
                remove_object(new)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for old, new in zip(objects, made, strict=True):
            finish_painting(old)
            was_active = old == active
            if self.keep_original:
                for collection in old.users_collection:
                    collection.objects.link(new)
                old.select_set(False)
                old.hide_viewport = old.hide_render = True
            else:
                replace_object(old, new)
            new.select_set(True)
            if was_active:
                context.view_layer.objects.active = new
        return {"FINISHED"}


class DOGSPLAT_OT_to_native(Conversion, bpy.types.Operator):
    """Let Blender draw the selected splats itself, as plain Gaussians. What crop, limits and painting hide is gone"""

    bl_idname = "dogsplat.to_native"
    bl_label = "Convert to Native"

    keep_original: BoolProperty(name="Keep Original", description=KEEP)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """This Blender draws splats, and some of ours are selected."""
        return context.mode == "OBJECT" and is_available() and any(map(can_edit, context.selected_objects))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """The points that are shown, with all of their attributes."""
        depsgraph = context.evaluated_depsgraph_get()

        def make(obj: bpy.types.Object) -> bpy.types.Object:
            mesh = applied_mesh(obj, depsgraph)
            try:
                model = read_attributes(mesh)
                plain = baked(command_of(context), model) if drawing_of(obj).get("DoG", True) else model
                return native_object(obj, mesh, model, plain)
            finally:
                bpy.data.meshes.remove(mesh)

        return self.convert(context, [obj for obj in context.selected_objects if can_edit(obj)], make)


class DOGSPLAT_OT_to_dog(Conversion, bpy.types.Operator):
    """Let the add-on draw the selected native splats: exactly, with their DoG, and with all edits made since"""

    bl_idname = "dogsplat.to_dog"
    bl_label = "Convert to DoG Splat"

    keep_original: BoolProperty(name="Keep Original", description=KEEP)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Native splats are selected."""
        return context.mode == "OBJECT" and any(map(can_edit_native, context.selected_objects))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """The points as their modifiers leave them."""
        depsgraph = context.evaluated_depsgraph_get()

        def make(obj: bpy.types.Object) -> bpy.types.Object:
            cloud = obj.evaluated_get(depsgraph).data
            try:
                return dog_object(obj, cloud, read_cloud(cloud))
            except ValueError as error:
                raise ValueError(told('"{name}": {reason}', name=obj.name, reason=error)) from error

        return self.convert(context, [obj for obj in context.selected_objects if can_edit_native(obj)], make)
