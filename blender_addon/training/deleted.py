"""Objects that were deleted: what a property names stays in the file, with all of its data, until that forgets it."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent


def is_there(obj: bpy.types.Object | None, scene: bpy.types.Scene | None = None) -> bool:
    """Whether it is in that scene, or in any."""
    return obj is not None and (scene in obj.users_scene if scene else bool(obj.users_scene))


@persistent
def forget_deleted(*_: object) -> None:
    """Clear the settings of trainings of objects that are in no scene any more, and remove those that nothing else has.

    Before a file is saved and not before: undo brings objects back.
    """
    deleted = set()
    for scene in (scene for scene in bpy.data.scenes if scene.library is None):
        settings = scene.dogsplat_training
        named = [(settings, "region"), (settings, "result"), *((entry, "object") for entry in settings.subjects)]
        for owner, name in named:
            obj = getattr(owner, name)
            if obj is not None and not is_there(obj):
                setattr(owner, name, None)
                deleted.add(obj)
    bpy.data.batch_remove([obj for obj in deleted if obj.users == 0])


def register() -> None:
    """The handler."""
    bpy.app.handlers.save_pre.append(forget_deleted)


def unregister() -> None:
    """Without it."""
    bpy.app.handlers.save_pre.remove(forget_deleted)
