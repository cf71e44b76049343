"""The panel "Train Splats" in the sidebar of the viewport."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface_

from .data_set import is_begun, is_complete
from .folder import training_folder
from .rig_operator import rig_cameras
from .run import can_go_on
from .settings import DogSplatTrainingSettings
from .work import WORK


class DOGSPLAT_PT_train(bpy.types.Panel):
    """A rig, its renders and a training on them."""

    bl_label = "Train Splats"
    bl_idname = "DOGSPLAT_PT_train"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "DoG Splat"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """What is at work, or what can be begun."""
        layout, settings = self.layout, context.scene.dogsplat_training
        layout.use_property_split, layout.use_property_decorate = True, False
        if WORK.busy:
            draw_work(layout)
            return
        if WORK.trouble:
            layout.label(text=WORK.trouble, icon="ERROR")
        draw_cameras(layout, settings)
        draw_pictures(layout, settings)
        draw_training(layout, settings)
        draw_buttons(layout, context.scene)


def draw_work(layout: bpy.types.UILayout) -> None:
    """How far it is, and how to stop it."""
    if WORK.rendering is not None:
        rendering = WORK.rendering.rendering
        done, n = rendering.done, len(rendering.frames)
        layout.progress(factor=done / n, text=iface_("{done} of {n} views").format(done=done, n=n), translate=False)
        layout.label(text="Esc stops; what is rendered is kept", icon="INFO")
    elif WORK.training is not None:
        step, steps = WORK.training.step, WORK.training.steps
        going_on = iface_("Step {step:,} of {steps:,}").format(step=step, steps=steps)
        text = iface_("Training starts") if not step else going_on if step < steps else iface_("Measuring")
        layout.progress(factor=min(step / steps, 1.0), text=text, translate=False)
        if WORK.stopping:
            layout.label(text="Stopping: a checkpoint is saved", icon="INFO")
        else:
            layout.operator("dogsplat.stop_training", icon="CANCEL")


def draw_cameras(layout: bpy.types.UILayout, settings: DogSplatTrainingSettings) -> None:
    """The rig."""
    column = layout.column()
    column.prop(settings, "subject")
    if settings.subject == "REGION":
        column.prop(settings, "region")
    column.prop(settings, "rig")
    column.prop(settings, "views")
    column.prop(settings, "elevations")
    if settings.rig == "AROUND":
        column.prop(settings, "zoom")
    column.operator("dogsplat.make_cameras", icon="OUTLINER_DATA_CAMERA")
    if cameras := rig_cameras(settings):
        text = iface_("{n} cameras in the rig").format(n=len(cameras))
        column.label(text=text, translate=False, icon="INFO")


def draw_pictures(layout: bpy.types.UILayout, settings: DogSplatTrainingSettings) -> None:
    """What the views are."""
    column = layout.column()
    for name in ("size", "alone", "transparent", "linear", "folder"):
        if name != "alone" or settings.subject == "SELECTED":
            column.prop(settings, name)


def draw_training(layout: bpy.types.UILayout, settings: DogSplatTrainingSettings) -> None:
    """What ``dogsplat train`` is told."""
    column = layout.column()
    for name in ("preset", "steps", "target", "max_primitives", "hide_originals"):
        if name != "target" or settings.preset != "3dgs":
            column.prop(settings, name)


def draw_buttons(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """What can be done with the folder as it is."""
    try:
        folder = training_folder(scene)
    except ValueError as error:
        layout.label(text=str(error), icon="ERROR")
        return
    begun, complete = is_begun(folder / "data"), is_complete(folder / "data")
    both = "Go On Rendering, and Train" if begun else "Render and Train"
    layout.operator("dogsplat.render_views", text=both, icon="RENDER_ANIMATION").train = True
    layout.operator("dogsplat.render_views", text="Go On Rendering" if begun else "Render Views").train = False
    if complete and can_go_on(folder / "run"):
        layout.operator("dogsplat.train", text="Go On Training", icon="PLAY").resume = True
    layout.operator("dogsplat.train", text="Train Anew" if (folder / "run").is_dir() else "Train").resume = False
