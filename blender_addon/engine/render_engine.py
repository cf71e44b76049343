"""Render engine "DoG Splat (Mitsuba)": the final frame as the ``dogsplat`` integrator makes it."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import EnumProperty

from ..cameras.objects import camera_numbers
from ..files.model import Model, concatenate
from ..nodes.modifier import get_input, splat_modifier
from ..objects.placed import placed_model, placed_splats
from ..preferences import command_of
from .renderers import Cancelled, RendererError, Settings, choose_renderer

ENGINE = "DOGSPLAT"
NEAR_CLIP = 0.2  # where no model of the scene has a modifier that says otherwise
COLORS = EnumProperty(name="Colors", default="LINEAR", items=(
    ("LINEAR", "Linear", "Scene-linear radiance: the exact picture under the view transform Standard"),
    ("DISPLAY", "Display", "sRGB values: the exact picture under the view transform Raw"),
))  # fmt: skip


class DogSplatEngine(bpy.types.RenderEngine):
    """Renders the splats of a scene, and only those, over the colour of its world."""

    bl_idname = ENGINE
    bl_label = "DoG Splat (Mitsuba)"
    bl_use_preview = False
    bl_use_eevee_viewport = True  # material preview shows the splats as with the other engines

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Render one view layer; errors end up in the status bar and in the report of the operator."""
        scene = depsgraph.scene
        try:
            model, settings = self._gather(depsgraph)
            camera = camera_numbers(scene, scene.camera.evaluated_get(depsgraph))
            renderer = choose_renderer(command_of(bpy.context))
            self.update_stats("", f"{model.n_splats:,} splats, {renderer.name}")
            picture = renderer.render(model, camera, settings, self.test_break, self.update_progress)
        except Cancelled:
            return
        except (ValueError, RendererError) as error:
            self.report({"ERROR"}, str(error))
            self.error_set(str(error))
            return
        self._show(scene, camera.width, camera.height, picture)

    def update_render_passes(self, scene: bpy.types.Scene, renderlayer: bpy.types.ViewLayer) -> None:
        """Offer the passes to the compositor."""
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        self.register_pass(scene, renderlayer, "Depth", 1, "Z", "VALUE")
        self.register_pass(scene, renderlayer, "Alpha", 1, "A", "VALUE")

    def _gather(self, depsgraph: bpy.types.Depsgraph) -> tuple[Model, Settings]:
        """All visible splats as one model in the space of the world. Raises ``ValueError`` where there is nothing."""
        if depsgraph.scene.camera is None:
            raise ValueError("the scene has no camera; add one, or import those of the data set")
        models, near, antialiased = [], [], False
        for obj, matrix in placed_splats(depsgraph):
            model = placed_model(obj, depsgraph, matrix)
            if modifier := splat_modifier(obj):
                model = model.with_degree(min(get_input(modifier, "SH Degree"), model.sh_degree))
                model.is_dog = model.is_dog & bool(get_input(modifier, "DoG"))
                near.append(get_input(modifier, "Near Clip"))
                antialiased |= bool(get_input(modifier, "Antialiased"))
            models.append(model)
        if not models:
            raise ValueError("the scene has no splats to render; import a model with File > Import > DoG Splat")
        return concatenate(models), Settings(max(near, default=NEAR_CLIP), antialiased)

    def _show(self, scene: bpy.types.Scene, width: int, height: int, picture: dict[str, np.ndarray]) -> None:
        """Hand the picture (rows from the top) to Blender (rows from the bottom)."""
        alpha = picture["alpha"]
        color = picture["color"]  # sRGB values over black
        linear = scene.dogsplat_colors == "LINEAR"
        if not scene.render.film_transparent:
            behind = _world_color(scene)
            color = color + (1 - alpha[..., None]) * (_linear_to_srgb(behind) if linear else behind)
            combined_alpha = np.ones_like(alpha)
        else:
            combined_alpha = alpha
        if linear:
            color = _srgb_to_linear(color)
        passes = {
            "Combined": np.concatenate([color, combined_alpha[..., None]], axis=2),
            "Depth": np.where(alpha > 0, picture["depth"], 1e10)[..., None],
            "Alpha": alpha[..., None],
        }
        self.add_pass("Alpha", 1, "A")
        result = self.begin_result(0, 0, width, height)
        for name, values in passes.items():
            target = result.layers[0].passes.get(name)
            if target is not None:
                target.rect.foreach_set(np.ascontiguousarray(values[::-1], np.float32).ravel())
        self.end_result(result)
def _world_color(scene: bpy.types.Scene) -> np.ndarray:
    """Linear colour [3] behind the splats: the Background node of the world, or the colour of the world."""
    world = scene.world
    if world is None:
        return np.zeros(3)
    nodes = world.node_tree.nodes if world.node_tree else ()
    for node in nodes:
        if node.type == "BACKGROUND" and not node.inputs["Color"].is_linked:
            return np.array(node.inputs["Color"].default_value[:3]) * node.inputs["Strength"].default_value
    return np.array(world.color)


def _linear_to_srgb(x: np.ndarray) -> np.ndarray:
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)


def _srgb_to_linear(x: np.ndarray) -> np.ndarray:
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0.04045) + 0.055) / 1.055) ** 2.4)


def panels_for_all_engines() -> list[type]:
    """Blender's own panels that make sense with any engine: resolution, camera, output, …"""
    return [
        panel for panel in bpy.types.Panel.__subclasses__()
        if "BLENDER_RENDER" in getattr(panel, "COMPAT_ENGINES", ())
    ]  # fmt: skip
