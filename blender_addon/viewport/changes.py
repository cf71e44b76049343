"""Which changes of a file ask for another stage: those of splats, and of what else is rendered."""

from __future__ import annotations

import bpy

from ..engine.order import StageSettings, stage_settings
from ..evaluated.placed import holds_splats
from ..objects.attributes import has_splats
from .camera_moves import CameraMoves
from .tagged import TAGGED

SEEN = (bpy.types.Material, bpy.types.World, bpy.types.Light, bpy.types.Image, bpy.types.Texture, bpy.types.NodeTree)


class Changes:
    """Of one viewport, between the stages that it was shown."""

    def __init__(self):
        self.pending = True
        self._moves = CameraMoves()
        self._objects: tuple[tuple[str, bool], ...] = ()
        self._settings: StageSettings | None = None

    def note(self, depsgraph: bpy.types.Depsgraph) -> None:
        """What Blender tells before it draws. Cameras are no part of a stage."""
        objects = tuple((obj.name_full, obj.hide_render) for obj in depsgraph.objects)
        if objects != self._objects:  # shown or hidden
            self._objects, self.pending = objects, True
        self._moves.learn(depsgraph.objects)
        by_cameras = self._moves.explain(depsgraph.updates)
        self.pending |= not by_cameras and any(_matters(update) for update in depsgraph.updates)

    def compare(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Note what a stage depends on besides."""
        settings = stage_settings(depsgraph)
        if settings != self._settings:
            self._settings, self.pending = settings, True


def _matters(update: bpy.types.DepsgraphUpdate) -> bool:
    thing = update.id.original
    if not isinstance(thing, bpy.types.Object):
        return isinstance(thing, SEEN)
    geometry = update.is_updated_geometry and not TAGGED.is_ours(thing)
    if thing.type == "CAMERA" or not (geometry or update.is_updated_transform or _shades(update)):
        return False
    return thing.type != "EMPTY" or holds_splats(thing) or thing.instance_type != "NONE"


def _shades(update: bpy.types.DepsgraphUpdate) -> bool:
    return update.is_updated_shading and not has_splats(update.id.original)
