"""One view of the rig after the other into the data set; whoever renders them may stop in between."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import bpy

from ..cameras.camera import Camera
from ..cameras.objects import pinhole_numbers
from ..files.errors import told
from ..files.whole import remove
from ..objects.conventions import metres_of_unit
from .borrowed import Borrowed, hidden_objects
from .data_set import DataSet, Frame
from .folder import claim, training_folder
from .points import seen_points
from .rig import held_out
from .rig_operator import make_rig, rig_cameras

PICTURES = ("transparent", "linear", "alone", "subject")  # settings on which the pictures depend, with the engine


class Rendering:
    """``advance``, render, ``keep`` for each view that is not there yet, then ``complete``; in the end ``close``.

    The scene has other settings until then.
    """

    def __init__(self, context: bpy.types.Context):
        """Raises ``ValueError``, in one line that says what to do, with all settings as they were."""
        self._context, self._borrowed = context, Borrowed()
        scene = context.scene
        folder = training_folder(scene)
        cameras = rig_cameras(scene.dogsplat_training) or make_rig(context)
        with ExitStack() as undo:
            undo.callback(self.close)
            self._borrow(cameras)
            numbers = [_numbers(context, obj) for obj in cameras]
            suffix = ".exr" if scene.dogsplat_training.linear else ".png"
            self.data_set = DataSet(folder / "data", self._decisive(), suffix)
            claim(folder, scene)
            self.frames = [self.data_set.frame(camera) for camera in numbers]
            self._require_names()
            undo.pop_all()
        self._cameras = dict(zip((frame["file_path"] for frame in self.frames), cameras, strict=True))
        self._current: Frame | None = None

    @property
    def done(self) -> int:
        """How many views are rendered, of ``len(frames)``."""
        return sum(self.data_set.has(frame) for frame in self.frames)

    def advance(self) -> bool:
        """Make the scene ready for the next view, which ``bpy.ops.render.render(write_still=True)`` renders then.

        False where all are there.
        """
        self._current = next((frame for frame in self.frames if not self.data_set.has(frame)), None)
        if self._current is None:
            return False
        path, scene = self.data_set.path(self._current), self._context.scene
        remove(path)
        self._borrowed.set(scene, camera=self._cameras[self._current["file_path"]])
        self._borrowed.set(scene.render, filepath=_literal(path))
        return True

    def keep(self) -> None:
        """The view is rendered. Raises ``FileError`` if it is not."""
        if self._current is not None:
            self.data_set.keep(self._current)
        self._current = None

    def complete(self) -> None:
        """Write points and poses. Raises ``FileError``."""
        scene, tests = self._context.scene, held_out(len(self.frames))
        train = [frame for i, frame in enumerate(self.frames) if i not in tests]
        points = seen_points(self._context, train, self.data_set.path, set(hidden_objects(scene)))
        self.data_set.complete(self.frames, points, metres_of_unit(scene))

    def close(self) -> None:
        """Give the scene its settings back; what was rendered stays."""
        self._borrowed.give_back()

    def _borrow(self, cameras: list[bpy.types.Object]) -> None:
        scene = self._context.scene
        self._borrowed.set_size(scene)
        self._borrowed.set_picture(scene)
        self._borrowed.set_visible(scene, self._context.view_layer)
        for obj in cameras:
            self._borrowed.set(obj.data.dof, use_dof=False)
        for marker in scene.timeline_markers:  # a render looks through the camera of the latest one first
            self._borrowed.set(marker, camera=None)
        self._context.view_layer.update()

    def _decisive(self) -> dict:
        scene = self._context.scene
        found = {name: getattr(scene.dogsplat_training, name) for name in PICTURES}
        return {"engine": scene.render.engine, **found}

    def _require_names(self) -> None:
        names = [frame["file_path"] for frame in self.frames]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            problem = "two cameras of the rig would both write {name}; rename one of them"
            raise ValueError(told(problem, name=twice[0]))


def _literal(path: Path) -> str:
    """A path as render settings take it, where braces stand for values from Blender 4.5 on."""
    return str(path).replace("{", "{{").replace("}", "}}") if bpy.app.version >= (4, 5) else str(path)


def _numbers(context: bpy.types.Context, obj: bpy.types.Object) -> Camera:
    return pinhole_numbers(context.scene, obj.evaluated_get(context.evaluated_depsgraph_get()))
