"""Objects whose geometry only our own watcher changes: Blender tells of that as of any other change."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent


class Tagged:
    """Names of the objects that are tagged by us, until Blender has evaluated and told of them."""

    def __init__(self) -> None:
        self._waiting: set[str] = set()
        self._told: set[str] = set()

    def tag(self, obj: bpy.types.Object) -> None:
        """Have an object evaluated again, which changes no stage."""
        self._waiting.add(obj.name_full)
        obj.update_tag(refresh={"DATA"})

    def evaluated(self) -> None:
        """What Blender tells from now on, to all viewports, is about what was tagged since the last time."""
        self._told, self._waiting = self._waiting, set()

    def forget(self) -> None:
        """A frame has changed, and anything with it."""
        self._told, self._waiting = set(), set()

    def is_ours(self, obj: bpy.types.Object) -> bool:
        """Whether it is evaluated again because of us."""
        return obj.name_full in self._told


TAGGED = Tagged()


@persistent
def evaluated(*_: Any) -> None:
    """After Blender has evaluated a scene, before it tells viewports what has changed."""
    TAGGED.evaluated()


@persistent
def frame_changed(*_: Any) -> None:
    """After another frame."""
    TAGGED.forget()
