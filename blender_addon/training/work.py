"""What is at work now, for the panel and the buttons: one rendering or one training in all of Blender."""

from __future__ import annotations

import bpy

from .render_jobs import RenderJobs
from .run import TrainingRun


class Work:
    """At most one of the two, and how the latest training ended."""

    def __init__(self):
        self.rendering: RenderJobs | None = None
        self.timer: bpy.types.Timer | None = None  # by which the rendering is looked after
        self.training: TrainingRun | None = None
        self.stopping = False  # the training was asked to, and is not yet at its end
        self.scene = 0  # that the training is for: its session_uid, which a new name and undo leave
        self.scene_name = ""  # as it was called at the beginning
        self.trouble = ""  # one line

    @property
    def busy(self) -> bool:
        """Whether nothing else can begin."""
        return self.rendering is not None or self.training is not None

    def begin_rendering(self, jobs: RenderJobs, timer: bpy.types.Timer) -> None:
        """A rendering is at work."""
        self.rendering, self.timer = jobs, timer

    def end_rendering(self) -> None:
        """No rendering is at work any more."""
        self.rendering = self.timer = None

    def begin_training(self, run: TrainingRun, scene: bpy.types.Scene) -> None:
        """A training is at work, for that scene."""
        self.training, self.stopping = run, False
        self.scene, self.scene_name = scene.session_uid, scene.name

    def end_training(self) -> None:
        """No training is at work any more."""
        self.training, self.stopping = None, False


WORK = Work()
