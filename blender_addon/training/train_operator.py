"""Starts and stops a training, and brings its model in when it is done."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty

from ..files.errors import told
from ..package.renderers import process_words
from ..package.served import RendererError
from ..preferences import command_of
from ..windows import is_edited, redraw, tell
from .data_set import is_complete
from .folder import training_folder
from .result import place_result
from .run import TrainingRun, can_go_on
from .settings import DogSplatTrainingSettings
from .work import WORK

INTERVAL = 0.5  # seconds between looks at the training
ROWS = 200  # of the history, at most 50 steps apart


class DOGSPLAT_OT_train(bpy.types.Operator):
    """Train a model on the rendered views, in a process of its own, and import it in place of the subject"""

    bl_idname = "dogsplat.train"
    bl_label = "Train"

    resume: BoolProperty(
        name="Go On", default=False,
        description="Continue from the last checkpoint, with the same settings",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There is a data set, and nothing of this kind is at work."""
        return not WORK.busy and _complete(context.scene)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Blender goes on meanwhile; without a window, which has nothing else to do, it waits."""
        WORK.trouble = ""
        try:
            run = start(context, self.resume)
            if bpy.app.background:
                run.wait()
                place_result(context, run.require_result())
        except (ValueError, RuntimeError) as error:
            self.report({"ERROR"}, " ".join(str(error).split()))
            return {"CANCELLED"}
        if bpy.app.background:
            self.report({"INFO"}, told("trained, imported from {folder}", folder=run.folder))
            return {"FINISHED"}
        WORK.begin_training(run, context.scene)
        bpy.app.timers.register(look_after)
        return {"FINISHED"}


class DOGSPLAT_OT_stop_training(bpy.types.Operator):
    """Save a checkpoint and stop; Go On Training continues from there"""

    bl_idname = "dogsplat.stop_training"
    bl_label = "Stop Training"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """One is at work, and was not asked before."""
        return WORK.training is not None and not WORK.stopping

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Blender goes on: the timer that looks after the training notices its end."""
        WORK.training.ask_to_stop()
        WORK.stopping = True
        redraw(context)
        return {"FINISHED"}


def start(context: bpy.types.Context, resume: bool) -> TrainingRun:
    """The process of a training. Raises ``ValueError`` and ``RendererError``."""
    folder, settings = training_folder(context.scene), context.scene.dogsplat_training
    words, run = process_words(command_of(context)), folder / "run"
    return TrainingRun(words, folder / "data", run, flags_of(settings), resume and can_go_on(run))


def flags_of(settings: DogSplatTrainingSettings) -> dict[str, str]:
    """What ``dogsplat train`` is called with, without ``--``."""
    steps = settings.steps
    flags = {"preset": settings.preset, "steps": str(steps), "log-every": str(min(max(steps // ROWS, 1), 50))}
    if settings.preset != "3dgs":
        flags["target"] = settings.target
    if settings.max_primitives:
        flags["max-primitives"] = str(settings.max_primitives)
    if settings.transparent:
        flags["background"] = "random"  # else splats of the background's colour hide in it
    return flags


def stop(*_: object) -> None:
    """End what is at work, and wait until it is saved; it can go on later."""
    if WORK.training is not None:
        WORK.training.stop()
        WORK.end_training()


def look_after() -> float | None:
    """Called by a timer: bring in the model of a training that is done, and say what went wrong with one.

    One that was asked to stop ends without a word, unless it was done by then.
    """
    run, context = WORK.training, bpy.context
    if run is None:
        return None
    redraw(context)
    if WORK.stopping and not run.works and not run.is_complete:
        WORK.end_training()
        return None
    windows = [window for window in context.window_manager.windows if window.scene.session_uid == WORK.scene]
    if run.works or (windows and is_edited(windows[0])):
        return INTERVAL
    WORK.end_training()
    try:
        model = run.require_result()
        if not windows:
            problem = 'trained, but no window shows "{scene}"; import {model}'
            raise RendererError(problem, scene=WORK.scene_name, model=model)
        with context.temp_override(window=windows[0]):
            place_result(context, model)
            bpy.ops.ed.undo_push(message="Import Trained Splats")
    except (ValueError, RuntimeError) as error:
        WORK.trouble = " ".join(str(error).split())
        tell(context, WORK.trouble)
    return None


def _complete(scene: bpy.types.Scene) -> bool:
    try:
        return is_complete(training_folder(scene) / "data")
    except ValueError:
        return False


@persistent
def before_another_file(*_: object) -> None:
    """A model is not imported into a file that it is not of."""
    stop()


def register() -> None:
    """The handler."""
    bpy.app.handlers.load_pre.append(before_another_file)


def unregister() -> None:
    """No process stays behind, and no timer."""
    bpy.app.handlers.load_pre.remove(before_another_file)
    stop()
    if bpy.app.timers.is_registered(look_after):
        bpy.app.timers.unregister(look_after)
