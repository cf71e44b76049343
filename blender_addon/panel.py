"""The panels "DoG Splat" in the sidebar of the viewport and the render properties, and the entries of the menu File."""

from __future__ import annotations

import bpy

from .engine.passes import SETTINGS
from .engine.render_engine import ENGINE
from .nodes.modifier import input_property, splat_modifier
from .objects.attributes import is_splats
from .objects.conventions import DOG_COUNT, SOURCE

SHOWN = ("Show As", "SH Degree", "DoG", "Linear Colors", "Antialiased", "Near Clip")


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
            self._viewport(context.space_data)
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
        column.label(text=f"{obj.name}: {len(obj.data.vertices):,} splats", icon="POINTCLOUD_DATA")
        if SOURCE in obj:
            column.label(text=str(obj[SOURCE]), icon="FILE")
        modifier = splat_modifier(obj)
        if modifier is None:
            column.label(text="No splat modifier: import the model again", icon="ERROR")
            return
        column = layout.column()
        for name in SHOWN:
            column.prop(*input_property(modifier, name), text=name)
        if context.scene.camera is None:
            layout.label(text="Colours need an active camera", icon="INFO")
        elif obj.get(DOG_COUNT) and "EEVEE" in context.scene.render.engine:
            layout.label(text="EEVEE: no negative lobes", icon="INFO")
        layout.operator("dogsplat.apply_transform", icon="OBJECT_ORIGIN")

    def _viewport(self, space: bpy.types.SpaceView3D) -> None:
        """What hides the splats in a viewport as Blender opens it."""
        layout = self.layout
        if space.shading.type in ("SOLID", "WIREFRAME"):
            layout.label(text="Solid shading has no colours", icon="INFO")
            layout.prop_enum(space.shading, "type", "MATERIAL", text="Material Preview")
        layout.prop(space.overlay, "show_outline_selected", text="Outline Selected")


class DOGSPLAT_PT_render(bpy.types.Panel):
    """The settings of our engine, where those of every engine are: the render properties."""

    bl_label = "DoG Splat"
    bl_idname = "DOGSPLAT_PT_render"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "render"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Our engine is chosen."""
        return context.engine == ENGINE

    def draw(self, context: bpy.types.Context) -> None:
        """What is sent, and how the picture is handed to the view transform."""
        layout, settings = self.layout, context.scene.dogsplat
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(settings, "send")
        if settings.send == "SCENE":
            layout.prop(settings, "samples")
            layout.prop(settings, "bounces")
        layout.prop(context.scene, "dogsplat_colors", text="Colors of Splats Only")


class DOGSPLAT_PT_passes(bpy.types.Panel):
    """The passes of our engine, where those of every engine are: the properties of the view layer."""

    bl_label = "Passes"
    bl_idname = "DOGSPLAT_PT_passes"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "view_layer"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Our engine is chosen."""
        return context.engine == ENGINE

    def draw(self, context: bpy.types.Context) -> None:
        """Beside Combined and Alpha, which are always there."""
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        for name in SETTINGS.values():
            layout.prop(context.view_layer, name)


def import_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Entries of File > Import."""
    self.layout.operator("import_scene.dogsplat", text="DoG Splat (.ply)")
    self.layout.operator("import_scene.dogsplat_cameras", text="DoG Splat Cameras (COLMAP, transforms.json, run)")
    self.layout.operator("import_scene.dogsplat_path", text="DoG Splat Camera Path (.json, of dogsplat film)")


def export_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Entries of File > Export."""
    self.layout.operator("export_scene.dogsplat", text="DoG Splat (.ply)")
    self.layout.operator("export_scene.dogsplat_path", text="DoG Splat Camera Path (.json, for dogsplat film)")
