"""Renders the views of the rig: one after the other while Blender goes on drawing; all at once without a window."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty

from ..files.errors import told
from ..windows import redraw
from .render_jobs import RenderJobs
from .rendering import Rendering
from .work import WORK

INTERVAL = 0.1  # seconds between looks at the render job


class DOGSPLAT_OT_render_views(bpy.types.Operator):
    """Render the views of the rig into the data set. Esc stops, and the next start continues from there"""

    bl_idname = "dogsplat.render_views"
    bl_label = "Render Views"
    bl_options = {"UNDO"}

    train: BoolProperty(name="Train", default=False, description="Then train on them, and import the model")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Nothing of this kind is at work."""
        return context.mode == "OBJECT" and not WORK.busy and not bpy.app.is_job_running("RENDER")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """All views in one go, for scripts."""
        try:
            rendering = Rendering(context)
        except ValueError as error:
            return self._refused(error)
        try:
            while rendering.advance():
                bpy.ops.render.render(write_still=True)
                rendering.keep()
            rendering.complete()
        except (ValueError, RuntimeError) as error:
            return self._refused(error)
        finally:
            rendering.close()
        self.report({"INFO"}, told("{n} views rendered", n=len(rendering.frames)))
        return self._trained("EXEC_DEFAULT")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """View by view, by Blender's own render job."""
        if bpy.app.background:
            return self.execute(context)
        try:
            jobs = RenderJobs(context)
        except ValueError as error:
            return self._refused(error)
        WORK.begin_rendering(jobs, context.window_manager.event_timer_add(INTERVAL, window=context.window))
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """The scene has other settings meanwhile, so nothing else is let through."""
        jobs = WORK.rendering
        if event.type == "ESC":
            jobs.stopped = True
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        try:
            going_on = jobs.tick()
        except (ValueError, RuntimeError) as error:
            end(context)
            return self._refused(error)
        except BaseException:
            end(context)  # whatever it is: the scene gets its settings back
            raise
        redraw(context)
        done, n = jobs.rendering.done, len(jobs.rendering.frames)
        said = told("{done} of {n} views; Esc stops, and what is rendered is kept", done=done, n=n)
        context.workspace.status_text_set(said)
        if going_on:
            return {"RUNNING_MODAL"}
        end(context)
        if jobs.stopped:
            self.report(
                {"WARNING"}, told("stopped after {done} of {n} views; Go On Rendering does the rest", done=done, n=n)
            )
            return {"FINISHED"}
        self.report({"INFO"}, told("{n} views rendered", n=n))
        return self._trained("INVOKE_DEFAULT")

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender quits, or opens another file."""
        end(context)

    def _trained(self, how: str) -> set[str]:
        """The end, or where it is wanted the training, which may not be able to start."""
        if not self.train:
            return {"FINISHED"}
        try:
            return bpy.ops.dogsplat.train(how)
        except RuntimeError as error:
            return self._refused(error)

    def _refused(self, error: Exception) -> set[str]:
        self.report({"ERROR"}, " ".join(str(error).removeprefix("Error: ").split()))
        return {"CANCELLED"}


def end(context: bpy.types.Context) -> None:
    """End the rendering that is at work; the scene gets its settings back, and what was rendered stays."""
    WORK.rendering.close()
    if WORK.timer is not None:
        context.window_manager.event_timer_remove(WORK.timer)
    WORK.end_rendering()
    context.workspace.status_text_set(None)
    redraw(context)


def unregister() -> None:
    """Blender calls no ``cancel`` of an operator that goes while it is modal."""
    if WORK.rendering is not None:
        end(bpy.context)
