"""Cameras that move: Blender evaluates splats anew, whose quads face the active one, and no splat is another."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy

from ..native.convert import drawing_of
from ..nodes.modifier import edit_modifiers, get_input, splat_modifier
from ..objects.attributes import is_splats

Edits = tuple[tuple[str, Any], ...]


class CameraMoves:
    """What hid, tinted and drew the splats of each object when Blender told of it last."""

    def __init__(self) -> None:
        self._edits: dict[str, Edits | None] = {}

    def learn(self, objects: Iterable[bpy.types.Object]) -> None:
        """Note objects that are new."""
        for obj in (obj.original for obj in objects):
            if obj.name_full not in self._edits and is_splats(obj):
                self._edits[obj.name_full] = _edits(obj)

    def explain(self, updates: Iterable[bpy.types.DepsgraphUpdate]) -> bool:
        """Whether cameras are all that has changed; splats that were evaluated with them are edited as before."""
        cameras, others = 0, 0
        for update in updates:
            thing = update.id.original
            if _is_camera(thing):
                cameras += 1
            elif not isinstance(thing, bpy.types.Scene) and not self._is_drawn_anew(update):
                others += 1  # go on: each is noted
        return cameras > 0 and others == 0

    def _is_drawn_anew(self, update: bpy.types.DepsgraphUpdate) -> bool:
        obj = update.id.original
        if not isinstance(obj, bpy.types.Object) or not is_splats(obj):
            return False
        before, now = self._edits.get(obj.name_full), _edits(obj)
        self._edits[obj.name_full] = now
        alone = update.is_updated_geometry and not update.is_updated_transform
        return alone and now is not None and now == before


def _is_camera(thing: bpy.types.ID) -> bool:
    return isinstance(thing, bpy.types.Camera) or (isinstance(thing, bpy.types.Object) and thing.type == "CAMERA")


def _edits(obj: bpy.types.Object) -> Edits | None:
    """The modifiers of an object and their inputs; None where a camera may change more than how splats are drawn."""
    ours, drawing = edit_modifiers(obj), splat_modifier(obj)
    if len(ours) + (drawing is not None) != len(obj.modifiers) or obj.data.shape_keys:
        return None
    found: list[tuple[str, Any]] = [("drawn", tuple(drawing_of(obj).items()))]
    for modifier in ours:
        values: dict[str, Any] = {"shown": modifier.show_viewport}
        for item in modifier.node_group.interface.items_tree:
            if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.socket_type != "NodeSocketGeometry":
                values[item.name] = _plain(get_input(modifier, item.name))
        if any(isinstance(value, bpy.types.Object) and value.type == "CAMERA" for value in values.values()):
            return None
        found.append((modifier.name, tuple(values.items())))
    return tuple(found)


def _plain(value: Any) -> Any:
    """A value that stays what it is when Blender changes it."""
    return value if isinstance(value, (bool, int, float, str, bpy.types.ID, type(None))) else tuple(value)
