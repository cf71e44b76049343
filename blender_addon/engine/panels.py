"""What the properties show while our engine is chosen: its own panels, and those of Blender's engines that it obeys."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..evaluated.masks import UNSEEN
from .passes import SETTINGS
from .settings import ENGINE

# Panels of EEVEE with nothing, or little, that our engine does not read
OF_EEVEE = (
    "EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface", "EEVEE_WORLD_PT_surface", "DATA_PT_EEVEE_light",
    "DATA_PT_camera_dof", "DATA_PT_camera_dof_aperture",
)  # fmt: skip
WITHOUT_POWER = ("DATA_PT_light",)  # the panel of a light for engines that have none of their own: its kind alone


def shared_panels() -> Iterator[type[bpy.types.Panel]]:
    """Panels of Blender itself that stand with our engine: those for any engine, and those of EEVEE."""
    for panel in bpy.types.Panel.__subclasses__():
        name = panel.__name__.removeprefix("NODE_")  # of a copy in the node editor, which shares its set of engines
        for_any = "BLENDER_RENDER" in getattr(panel, "COMPAT_ENGINES", ()) and name not in WITHOUT_POWER
        if for_any or name in OF_EEVEE:
            yield panel


def split(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """The layout with names to the left of values, and no dots for key frames."""
    layout.use_property_split, layout.use_property_decorate = True, False
    return layout


class OfEngine:
    """A panel that stands where those of every engine do, while ours is chosen."""

    bl_space_type, bl_region_type = "PROPERTIES", "WINDOW"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Our engine is chosen."""
        return context.engine == ENGINE


class DOGSPLAT_PT_render(OfEngine, bpy.types.Panel):
    """The settings of our engine."""

    bl_label = "DoG Splat"
    bl_idname = "DOGSPLAT_PT_render"
    bl_context = "render"

    def draw(self, context: bpy.types.Context) -> None:
        """What is sent, and how the picture is handed to the view transform."""
        layout, settings = split(self.layout), context.scene.dogsplat
        layout.prop(settings, "send")
        if settings.send == "SCENE":
            layout.prop(settings, "samples")
            layout.prop(settings, "denoise")
            layout.prop(settings, "bounces")
            layout.prop(settings, "mesh_shadows")
        layout.prop(context.scene, "dogsplat_colors", text="Colors of Splats Only")


class DOGSPLAT_PT_passes(OfEngine, bpy.types.Panel):
    """The passes of our engine."""

    bl_label = "Passes"
    bl_idname = "DOGSPLAT_PT_passes"
    bl_context = "view_layer"

    def draw(self, context: bpy.types.Context) -> None:
        """Beside Combined and Alpha, which are always there."""
        layout = split(self.layout)
        for name in SETTINGS.values():
            layout.prop(context.view_layer, name)


class DOGSPLAT_PT_override(OfEngine, bpy.types.Panel):
    """Of what a view layer may override, that which our engine obeys."""

    bl_label = "Override"
    bl_idname = "DOGSPLAT_PT_override"
    bl_context = "view_layer"

    def draw(self, context: bpy.types.Context) -> None:
        """Splats keep their colors."""
        split(self.layout).prop(context.view_layer, "material_override")


class DOGSPLAT_PT_film(OfEngine, bpy.types.Panel):
    """What Blender keeps in the render settings, and shows for each engine in a panel of its own."""

    bl_label = "Film"
    bl_idname = "DOGSPLAT_PT_film"
    bl_context = "render"

    def draw(self, context: bpy.types.Context) -> None:
        """The filter is that of a sensor, which splats alone have none of."""
        layout, render = split(self.layout), context.scene.render
        layout.prop(render, "film_transparent", text="Transparent")
        if context.scene.dogsplat.send == "SCENE":
            layout.prop(render, "filter_size")


class DOGSPLAT_PT_visibility(OfEngine, bpy.types.Panel):
    """Of the rays that Cycles distinguishes, those that our engine does."""

    bl_label = "Ray Visibility"
    bl_idname = "DOGSPLAT_PT_visibility"
    bl_parent_id = "OBJECT_PT_visibility"
    bl_context = "object"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """The object is something to see."""
        return super().poll(context) and context.object is not None and context.object.type not in UNSEEN

    def draw(self, context: bpy.types.Context) -> None:
        """Holdout is in Blender's own panel."""
        split(self.layout).prop(context.object, "visible_camera", text="Camera")
