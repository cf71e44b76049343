"""The panels "DoG Splat" and "Edit Splats" in the sidebar of the viewport, and the entries of Blender's menus."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface_

from .editing.paint_operators import painted_model
from .editing.stand_in import stand_in_of
from .engine.settings import ENGINE
from .files.model import CURVATURES, PLANES, SHIFTS, SLOPES
from .nodes.crop import NAME as CROP
from .nodes.limits import NAME as LIMITS
from .nodes.modifier import SHOWN, edit_modifiers, has_input, input_property, splat_modifier, tree_name
from .nodes.paint import NAME as PAINT
from .nodes.suited import is_suited
from .objects.attributes import can_edit, can_edit_native, has_any, is_native, is_splats
from .objects.conventions import DOG_COUNT, SOURCE
from .objects.feature import is_available
from .objects.working_space import is_converted
from .surface.operator import draw_surface

EDITED = {
    CROP: ("Shape", "Object", "Invert"),
    LIMITS: ("Minimum Opacity", "Minimum Size", "Maximum Size", "Maximum Count", "Count By"),
    PAINT: ("Erase", "Threshold", "Tint"),
}


class DOGSPLAT_PT_panel(bpy.types.Panel):
    """Settings of the active model, and what can be done with models and cameras."""

    bl_label = "DoG Splat"
    bl_idname = "DOGSPLAT_PT_panel"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "DoG Splat"

    def draw(self, context: bpy.types.Context) -> None:
        """The model first, then the scene."""
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        obj = context.object
        if is_splats(obj):
            self._model(context, obj)
            self._viewport(context.scene, context.space_data)
            if is_available():
                layout.operator("dogsplat.to_native", icon="POINTCLOUD_DATA")
        elif is_native(obj):
            text = iface_("{name}: plain Gaussians, by Blender").format(name=obj.name)
            layout.label(text=text, translate=False, icon="POINTCLOUD_DATA")
            _note_groups(layout, context.scene, obj)
            layout.operator("dogsplat.to_dog")
            draw_surface(layout)
        row = layout.row(align=True)
        row.operator("import_scene.dogsplat", text="Import", icon="IMPORT")
        row.operator("export_scene.dogsplat", text="Export", icon="EXPORT")
        layout.operator("import_scene.dogsplat_cameras", text="Import Cameras", icon="OUTLINER_DATA_CAMERA")
        layout.operator("dogsplat.look_through", icon="VIEW_CAMERA")
        layout.separator()
        layout.operator("dogsplat.exact_settings", icon="SCENE")
        layout.prop(context.scene.render, "engine")
        if context.scene.render.engine == ENGINE:
            layout.prop(context.scene, "dogsplat_colors")

    def _model(self, context: bpy.types.Context, obj: bpy.types.Object) -> None:
        layout = self.layout
        column = layout.column(align=True)
        text = iface_("{name}: {count:,} splats").format(name=obj.name, count=len(obj.data.vertices))
        column.label(text=text, translate=False, icon="POINTCLOUD_DATA")
        if SOURCE in obj:
            column.label(text=str(obj[SOURCE]), translate=False, icon="FILE")
        modifier = splat_modifier(obj)
        if modifier is None:
            column.label(text="No splat modifier: import the model again", icon="ERROR")
            return
        if is_converted(obj):
            column.label(text="Working space changed: import the model again", icon="ERROR")
        elif not is_suited(obj):
            column.label(text="Blender draws colors of another working space", icon="ERROR")
        column = layout.column()
        for name in (name for name in SHOWN if has_input(modifier, name)):
            column.prop(*input_property(modifier, name), text=name)
        if context.scene.camera is None and not context.scene.dogsplat_follow_view:
            layout.label(text="Colors need an active camera, or Follow View", icon="INFO")
        elif obj.get(DOG_COUNT) and "EEVEE" in context.scene.render.engine:
            layout.label(text="EEVEE: no negative lobes", icon="INFO")
        _note_groups(layout, context.scene, obj)

    def _viewport(self, scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> None:
        """What a moving viewport shows, and what hides the splats in one as Blender opens it."""
        layout = self.layout
        layout.prop(scene, "dogsplat_moving")
        if scene.dogsplat_moving != "ALL":
            layout.prop(scene, "dogsplat_moving_count", text="Splats")
        layout.prop(scene, "dogsplat_follow_view")
        if space.shading.type in ("SOLID", "WIREFRAME"):
            layout.label(text="Solid shading has no colors", icon="INFO")
            layout.prop_enum(space.shading, "type", "MATERIAL", text="Material Preview")
        layout.prop(space.overlay, "show_outline_selected", text="Outline Selected")


def _note_groups(layout: bpy.types.UILayout, scene: bpy.types.Scene, obj: bpy.types.Object) -> None:
    """What the engines of Blender leave out."""
    if scene.render.engine == ENGINE:
        return
    if scene.render.use_multiview and scene.render.views_format == "MULTIVIEW" and is_splats(obj):
        layout.label(text="Multi-View: quads of the active camera", icon="INFO")
    if "EEVEE" in scene.render.engine and is_splats(obj) and len(list(filter(is_splats, scene.objects))) > 1:
        layout.label(text="EEVEE: join models that overlap", icon="INFO")
    if has_any(obj, SLOPES):
        layout.label(text="Blender draws mean colors, no slopes", icon="INFO")
    if has_any(obj, CURVATURES):
        layout.label(text="Blender draws mean brightness, no curvatures", icon="INFO")
    if has_any(obj, *PLANES):
        layout.label(text="Blender draws whole splats, no cuts", icon="INFO")
    if has_any(obj, SHIFTS):
        layout.label(text="Blender draws mean places, no shifts", icon="INFO")


class DOGSPLAT_PT_edit(bpy.types.Panel):
    """What edits the active model, and the sliders of it."""

    bl_label = "Edit Splats"
    bl_idname = "DOGSPLAT_PT_edit"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "DoG Splat"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """A model, or what is painted in its place, is active."""
        return is_splats(painted_model(context.object))

    def draw(self, context: bpy.types.Context) -> None:
        """Tools first, then the modifiers that are there, in the order in which they act."""
        layout, obj = self.layout, painted_model(context.object)
        layout.use_property_split = True
        layout.operator_menu_enum("dogsplat.add_crop", "shape", text="Add Crop", icon="MOD_BOOLEAN")
        layout.operator("dogsplat.add_limits", icon="FILTER")
        layout.operator_menu_enum("dogsplat.paint", "what", text="Paint", icon="BRUSH_DATA")
        if stand_in_of(obj) is not None:
            layout.operator("dogsplat.finish_painting", icon="CHECKMARK")
        for modifier in edit_modifiers(obj):
            column = layout.box().column()
            row = column.row(align=True)
            row.prop(modifier, "name", text="")
            row.prop(modifier, "show_viewport", text="")
            row.prop(modifier, "show_render", text="")
            for name in EDITED[tree_name(modifier)]:
                column.prop(*input_property(modifier, name), text=name)
        layout.separator()
        layout.operator("dogsplat.apply_edits", icon="CHECKMARK")
        layout.operator("dogsplat.join", icon="OBJECT_DATA")
        layout.operator("dogsplat.apply_transform", icon="OBJECT_ORIGIN")
        layout.separator()
        draw_surface(layout)


def import_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Entries of File > Import."""
    self.layout.operator("import_scene.dogsplat", text="DoG Splat (.ply/.spz/.sog/.glb/.usd)")
    self.layout.operator("import_scene.dogsplat_cameras", text="DoG Splat Cameras (COLMAP, transforms.json, run)")
    self.layout.operator("import_scene.dogsplat_path", text="DoG Splat Camera Path (.json, of dogsplat film)")


def export_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Entries of File > Export."""
    self.layout.operator("export_scene.dogsplat", text="DoG Splat (.ply)")
    self.layout.operator("export_scene.dogsplat_path", text="DoG Splat Camera Path (.json, for dogsplat film)")


def apply_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Entry of Object > Apply (Ctrl A)."""
    if can_edit(context.object):
        self.layout.separator()
        self.layout.operator("dogsplat.apply_transform", text="All Transforms to Splats")
        self.layout.operator("dogsplat.apply_edits", text="Edits of Splats")


def object_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Entries of Object."""
    if can_edit(context.object):
        self.layout.separator()
        self.layout.operator("dogsplat.join")
    if can_edit(context.object) or can_edit_native(context.object):
        self.layout.operator("dogsplat.surface_mesh")


OBJECT_MENUS = (("VIEW3D_MT_object_apply", apply_menu), ("VIEW3D_MT_object", object_menu))
