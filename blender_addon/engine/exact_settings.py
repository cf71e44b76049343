"""The settings under which Blender's engines make the picture of the ``dogsplat`` integrator."""

from __future__ import annotations

import bpy
from bpy.props import IntProperty

from ..evaluated.placed import objects_in
from ..files.errors import told
from ..nodes.modifier import get_input, set_input, splat_modifier

MAX_SPLATS_PER_RAY = 1024  # the most that Cycles can


class DOGSPLAT_OT_exact_settings(bpy.types.Operator):
    """Set view transform, sampling and filter of this scene, and the colors of its models, for the exact picture"""

    bl_idname = "dogsplat.exact_settings"
    bl_label = "Set Up Exact Picture"
    bl_options = {"REGISTER", "UNDO"}

    samples: IntProperty(
        name="Samples",
        default=1,
        min=1,
        max=64,
        description="1 samples the pixel centers, as splatting does. More samples smooth the edges of other objects",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """EEVEE and Cycles at once; what else the scene has stays as it is."""
        scene = context.scene
        view = scene.view_settings
        view.view_transform, view.look, view.exposure, view.gamma = "Raw", "None", 0.0, 1.0
        view.use_curve_mapping = False
        if hasattr(view, "use_white_balance"):  # from Blender 4.3 on
            view.use_white_balance = False
        scene.render.image_settings.color_management = "FOLLOW_SCENE"  # files may have view settings of their own
        scene.eevee.taa_render_samples = self.samples
        scene.render.filter_size = 0.01 if self.samples == 1 else 1.0
        if hasattr(scene, "cycles"):
            cycles = scene.cycles
            cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = self.samples, False, False
            cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
            cycles.transparent_max_bounces = cycles.min_transparent_bounces = MAX_SPLATS_PER_RAY
        models = [(obj, modifier) for obj in objects_in(scene) if (modifier := splat_modifier(obj))]
        for obj, modifier in models:
            if obj.library is None:  # of a linked one, nothing would be saved
                set_input(modifier, "Linear Colors", False)
                obj.update_tag()
        linear = [obj.name for obj, modifier in models if get_input(modifier, "Linear Colors")]
        if linear:
            problem = "set up, but models of linked files keep their colors: {names}; make library overrides of them"
            self.report({"WARNING"}, told(problem, names=", ".join(linear)))
        else:
            self.report({"INFO"}, told("View transform Raw, pixel filter of one pixel, exact colors"))
        return {"FINISHED"}
