"""``dogsplat mesh`` as a process, of what an object of splats shows, in the coordinates of that object."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ..evaluated.placed import placed_model
from ..files.errors import told
from ..files.linear_map import check_regular
from ..files.model import Model
from ..files.ply import write_ply
from ..import_export.exported import said_of_all
from ..native.convert import drawing_of
from ..objects.conventions import light_of
from ..package.folder import own_folder
from ..package.renderers import process_words
from ..package.served import RendererError
from ..package.task import Task


class SurfaceRun:
    """From its start to its end, with a folder of its own for what goes to the package and comes from it."""

    def __init__(self, command: str, obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, flags: list[str]):
        """``command`` is that of the preferences; ``flags`` are those of ``dogsplat mesh``.

        Raises ``ValueError`` and ``RendererError``.
        """
        self.name = obj.name
        model, comments = shown_model(obj, depsgraph), written_comments(obj)
        words = process_words(command)
        folder, self._remove = own_folder(self)
        self._model, kind = folder / "splats.ply", "obj" if "--texture" in flags else "ply"
        self.out = folder / f"surface.{kind}"
        try:
            write_ply(self._model, model, comments)
            self.task = Task([*words, "mesh", str(self._model), "-o", str(self.out), *flags], folder / "log.txt")
        except (ValueError, RuntimeError):
            self._remove()
            raise

    def require_result(self) -> None:
        """Waits for the end. Raises ``ValueError``: in one line what the package complained of."""
        try:
            self.task.require(self.out)
        except RendererError as error:
            reason = str(error).removeprefix(f"{self._model}: ")
            raise ValueError(told('"{name}": {reason}', name=self.name, reason=reason)) from error

    def close(self) -> None:
        """End what is still at work, and remove the folder."""
        self.task.stop()
        self._remove()


def shown_model(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Model:
    """The splats that an object shows, as it draws them, in its own space. Raises ``ValueError`` where none are."""
    model = placed_model(obj, depsgraph, np.eye(4))
    if model.n_splats == 0:
        raise ValueError(told('"{name}": it shows no splats; open its crop and its limits', name=obj.name))
    if drawing := drawing_of(obj.evaluated_get(depsgraph)):  # with the keys of this frame
        model = model.with_degree(min(drawing["SH Degree"], model.sh_degree))
        model.is_dog = model.is_dog & bool(drawing["DoG"])
    return model


def written_comments(obj: bpy.types.Object) -> list[str]:
    """How it is to be drawn; what is upright is so in the scene. Raises ``ValueError`` for an object that is flat."""
    matrix = np.array(obj.matrix_world, np.float64)
    try:
        check_regular(matrix[:3, :3])
    except ValueError as error:
        raise ValueError(told('"{name}": {reason}', name=obj.name, reason=error)) from error
    own = np.linalg.inv(matrix)
    up = own[:3, 2] / np.linalg.norm(own[:3, 2])
    said = replace(said_of_all(obj, [obj], own), up=tuple(up.tolist()), scale=None)
    return said.lit(light_of(obj)).comments
