"""What is at work now, for the panel and the buttons: one rendering or one training in all of Blender."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:
    from .render_operator import RenderJobs
    from .run import TrainingRun


class Work:
    """At most one of the two, and how the latest training ended."""

    def __init__(self):
        self.rendering: RenderJobs | None = None
        self.training: TrainingRun | None = None
        self.scene = ""  # that the training is for
        self.trouble = ""  # one line

    @property
    def busy(self) -> bool:
        """Whether nothing else can begin."""
        return self.rendering is not None or self.training is not None


WORK = Work()


def redraw(context: bpy.types.Context) -> None:
    """The panels of all viewports, which show how far it is."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
