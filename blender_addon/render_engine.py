"""Render engine "DoG Splat (Mitsuba)": splats and the scene around them, through Mitsuba."""

from __future__ import annotations

import traceback

import bpy
import numpy as np
from bpy.app.translations import pgettext_iface as iface_

from .cameras.objects import Eye
from .engine import passes
from .engine.order import Order, make_order, tidy
from .engine.settings import ENGINE
from .files.errors import readable
from .package.renderers import choose_renderer
from .package.served import Cancelled, RendererError
from .preferences import command_of
from .viewport.rendered import Rendered


class DogSplatEngine(bpy.types.RenderEngine):
    """Renders a scene with its splats, or the splats alone over the colour of its world."""

    bl_idname = ENGINE
    bl_label = "DoG Splat (Mitsuba)"
    bl_use_preview = False
    bl_use_shading_nodes_custom = False  # the shader editor offers Blender's nodes
    bl_use_eevee_viewport = True  # material preview shows the splats as with the other engines

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Render one view layer; errors end up in the status bar and in the report of the operator."""
        layer = depsgraph.view_layer_eval
        views = [view.name for view in self.get_result().views]  # two eyes, say; mostly one without a name
        try:
            for name, (channels, letters, _, _) in passes.offered(layer).items():
                self.add_pass(name, channels, letters, layer=layer.name)
            for number, view in enumerate(views):
                self._render_view(depsgraph, view, number / len(views), 1 / len(views))
        except Cancelled:
            return
        except (ValueError, OSError, RendererError) as error:
            self._fail(str(error))
        except Exception as error:  # of which Blender would save an empty frame, or end where that is OpenEXR
            traceback.print_exc()
            self._fail(f"{type(error).__name__}: {error}")

    def _fail(self, problem: str) -> None:
        line = readable(" ".join(problem.split()))
        self.report({"ERROR"}, line)
        self.error_set(line)

    def _render_view(self, depsgraph: bpy.types.Depsgraph, view: str, done: float, share: float) -> None:
        """Render one of the views of a view layer, which is this share of the work. Raises as ``render`` catches."""
        scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
        renderer = choose_renderer(command_of(bpy.context))
        self.update_stats("", iface_("sending the scene"))
        order = make_order(depsgraph, renderer.folder, passes.wanted(layer), *self._camera_of(view))
        tidy(renderer.folder, order.files)
        for note in order.notes:
            self.report({"WARNING"}, note)
        count = sum(order.request["counts"])
        self.update_stats("", iface_("{count:,} splats, {name}").format(count=count, name=renderer.name))

        def show(picture: dict[str, np.ndarray]) -> None:
            self._show(scene, order, picture, layer.name, view)

        def progress(part: float) -> None:
            self.update_progress(done + share * part)

        show(renderer.render(order.request, self.test_break, progress, show))
        if "matte" in order.request["passes"]:
            for key, text in passes.matte_metadata(layer.name, order).items():
                self.get_result().stamp_data_add_field(key, text)

    def _camera_of(self, view: str) -> tuple[bpy.types.Object | None, Eye | None]:
        """The camera of a view, and from where it looks; None for a scene without one."""
        self.active_view_set(view)
        camera = self.camera_override
        if camera is None or camera.type != "CAMERA":  # of which Blender itself would crash
            return camera, None
        return camera, (self.camera_model_matrix(camera), self.camera_shift_x(camera))

    def view_update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Something has changed that a viewport in Rendered shading may show."""
        self._viewport().note(depsgraph)

    def view_draw(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Draw such a viewport; errors stand in its corner."""
        viewport = self._viewport()
        viewport.draw(context, depsgraph)
        self.update_stats("", viewport.error)

    def _viewport(self) -> Rendered:
        if not hasattr(self, "_rendered"):
            self._rendered = Rendered()
        return self._rendered

    def update_render_passes(self, scene: bpy.types.Scene, renderlayer: bpy.types.ViewLayer) -> None:
        """Offer the passes to the compositor.

        Its Alpha is that of Combined. Another pass of that name costs the node its sockets and links, and may even end
        Blender.
        """
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        for name, (channels, letters, kind, _) in passes.offered(renderlayer).items():
            if name != passes.ALPHA:
                self.register_pass(scene, renderlayer, name, channels, letters, kind)

    def _show(
        self, scene: bpy.types.Scene, order: Order, picture: dict[str, np.ndarray], layer: str, view: str
    ) -> None:
        """Hand the picture (rows from the top) to Blender (rows from the bottom)."""
        result = self.begin_result(0, 0, order.camera.width, order.camera.height, layer=layer, view=view)
        for name, values in passes.values(order, picture, scene).items():
            target = result.layers[0].passes.get(name)
            if target is not None:
                target.rect.foreach_set(np.ascontiguousarray(values[::-1], np.float32).ravel())
        self.end_result(result)
