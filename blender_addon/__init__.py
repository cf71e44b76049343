"""DoG Splat: Gaussian and Difference-of-Gaussians splats in Blender. This file only registers."""

from __future__ import annotations

import bpy

from . import panel, preferences, render_engine, translations
from .cameras import operators as camera_operators
from .cameras import path_import_operator, path_operator
from .editing import apply_operator, following, join_operator, live_operators, paint_operators, transform_operator
from .engine import exact_settings
from .engine import panels as engine_panels
from .engine import settings as engine_settings
from .import_export import export_operators, import_operator
from .native import operators as native_operators
from .nodes import suited
from .package import renderers
from .scene import written_images
from .surface import operator as surface_operator
from .training import deleted, render_operator, rig_operator, train_operator
from .training import panel as training_panel
from .training import settings as training_settings
from .viewport import handlers

CLASSES = (
    preferences.DogSplatPreferences,
    import_operator.DOGSPLAT_OT_import,
    import_operator.DOGSPLAT_FH_model,
    camera_operators.DOGSPLAT_OT_import_cameras,
    camera_operators.DOGSPLAT_OT_look_through,
    path_operator.DOGSPLAT_OT_export_path,
    path_import_operator.DOGSPLAT_OT_import_path,
    export_operators.DOGSPLAT_OT_export,
    live_operators.DOGSPLAT_OT_add_crop,
    live_operators.DOGSPLAT_OT_add_limits,
    paint_operators.DOGSPLAT_OT_paint,
    paint_operators.DOGSPLAT_OT_finish_painting,
    apply_operator.DOGSPLAT_OT_apply_edits,
    join_operator.DOGSPLAT_OT_join,
    transform_operator.DOGSPLAT_OT_apply_transform,
    native_operators.DOGSPLAT_OT_to_native,
    native_operators.DOGSPLAT_OT_to_dog,
    surface_operator.DOGSPLAT_OT_surface_mesh,
    surface_operator.DOGSPLAT_OT_stop_surface_mesh,
    exact_settings.DOGSPLAT_OT_exact_settings,
    engine_settings.DogSplatRenderSettings,
    render_engine.DogSplatEngine,
    training_settings.DogSplatSubject,
    training_settings.DogSplatTrainingSettings,
    rig_operator.DOGSPLAT_OT_make_cameras,
    render_operator.DOGSPLAT_OT_render_views,
    train_operator.DOGSPLAT_OT_train,
    train_operator.DOGSPLAT_OT_stop_training,
    panel.DOGSPLAT_PT_panel,
    panel.DOGSPLAT_PT_edit,
    training_panel.DOGSPLAT_PT_train,
    engine_panels.DOGSPLAT_PT_render,
    engine_panels.DOGSPLAT_PT_film,
    engine_panels.DOGSPLAT_PT_passes,
    engine_panels.DOGSPLAT_PT_override,
    engine_panels.DOGSPLAT_PT_visibility,
)


def register() -> None:
    """Called by Blender when the extension is enabled."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.dogsplat_colors = engine_settings.COLORS
    bpy.types.Scene.dogsplat_training = bpy.props.PointerProperty(type=training_settings.DogSplatTrainingSettings)
    bpy.types.Scene.dogsplat = bpy.props.PointerProperty(type=engine_settings.DogSplatRenderSettings)
    for blender_panel in engine_panels.shared_panels():
        blender_panel.COMPAT_ENGINES.add(engine_settings.ENGINE)
    bpy.types.TOPBAR_MT_file_import.append(panel.import_menu)
    bpy.types.TOPBAR_MT_file_export.append(panel.export_menu)
    for menu, draw in panel.OBJECT_MENUS:
        getattr(bpy.types, menu).append(draw)
    bpy.app.handlers.depsgraph_update_post.append(following.follow)
    suited.register()
    written_images.register()
    handlers.register()
    train_operator.register()
    surface_operator.register()
    deleted.register()
    translations.register(preferences.ADDON)


def unregister() -> None:
    """The same backwards."""
    translations.unregister(preferences.ADDON)
    deleted.unregister()
    render_operator.unregister()
    surface_operator.unregister()
    train_operator.unregister()
    handlers.unregister()
    written_images.unregister()
    suited.unregister()
    bpy.app.handlers.depsgraph_update_post.remove(following.follow)
    for menu, draw in reversed(panel.OBJECT_MENUS):
        getattr(bpy.types, menu).remove(draw)
    bpy.types.TOPBAR_MT_file_export.remove(panel.export_menu)
    bpy.types.TOPBAR_MT_file_import.remove(panel.import_menu)
    for blender_panel in engine_panels.shared_panels():
        blender_panel.COMPAT_ENGINES.discard(engine_settings.ENGINE)
    renderers.close_renderers()
    del bpy.types.Scene.dogsplat_colors, bpy.types.Scene.dogsplat, bpy.types.Scene.dogsplat_training
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
