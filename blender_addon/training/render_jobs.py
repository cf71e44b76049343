"""A rendering that goes on while Blender draws: one of its render jobs after the other."""

from __future__ import annotations

import bpy

from .rendering import Rendering


class RenderJobs:
    """A rendering by Blender's render jobs, of which one is at work at a time; no window shows them."""

    def __init__(self, context: bpy.types.Context):
        """Raises ``ValueError``."""
        self.rendering = Rendering(context)
        self.stopped = False
        self._view = context.preferences.view
        self._shown, self._view.render_display_type = self._view.render_display_type, "NONE"
        bpy.app.handlers.render_cancel.append(self._cancelled)

    def tick(self) -> bool:
        """Look after the job; False at the end. Raises ``ValueError`` and ``RuntimeError``."""
        if bpy.app.is_job_running("RENDER"):
            return True
        if self.stopped:
            return False
        self.rendering.keep()
        if self.rendering.advance():
            bpy.ops.render.render("INVOKE_DEFAULT", write_still=True)
            return True
        self.rendering.complete()
        return False

    def close(self) -> None:
        """Everything as it was."""
        bpy.app.handlers.render_cancel.remove(self._cancelled)
        self._view.render_display_type = self._shown
        self.rendering.close()

    def _cancelled(self, *_: object) -> None:
        """Blender ends a job by Esc itself, and lets nobody else see that key."""
        self.stopped = True
