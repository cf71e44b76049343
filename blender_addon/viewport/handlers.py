"""Where Blender calls the watcher: at each drawing of a viewport, by a timer, after undo, and with files."""

from __future__ import annotations

import time
from typing import Any

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, IntProperty

from .view import view_of
from .watcher import INTERVAL, Watcher, show

MOVING_COUNT = IntProperty(
    name="Splats While Moving",
    default=20_000,
    min=0,
    description="Viewports that move show so many splats, the most important ones; 0: all",
)
FOLLOW_VIEW = BoolProperty(
    name="Follow View",
    default=False,
    description="Make colours, and the quads of Automatic, for the viewport that moved last instead of the camera; "
    "renders stay with the camera",
    update=lambda scene, context: show(scene, 0, WATCHER.view if scene.dogsplat_follow_view else None),
)
WATCHER = Watcher()
_DRAWING: list[Any] = []


def _drawn() -> None:
    """A viewport is drawn."""
    context = bpy.context
    scene, space, region = context.scene, context.region_data, context.region
    if space is None or not (scene.dogsplat_moving_count or scene.dogsplat_follow_view):
        return
    if WATCHER.see(view_of(space, region.width, region.height), time.monotonic()) and not _ticking():
        bpy.app.timers.register(_tick, first_interval=INTERVAL)


def _ticking() -> bool:
    return bpy.app.timers.is_registered(_tick)


def _tick() -> float | None:
    return WATCHER.tick(bpy.context.scene, time.monotonic())


@persistent
def settle(*_: Any) -> None:
    """No file is saved, and none comes back, with splats left out."""
    for scene in bpy.data.scenes:
        show(scene, 0, WATCHER.view if scene.dogsplat_follow_view else None)


def _hooks() -> tuple[Any, ...]:
    handlers = bpy.app.handlers
    return handlers.load_post, handlers.save_pre, handlers.undo_post, handlers.redo_post


def register() -> None:
    """Settings of scenes, the handlers, and the callback of viewports."""
    bpy.types.Scene.dogsplat_moving_count = MOVING_COUNT
    bpy.types.Scene.dogsplat_follow_view = FOLLOW_VIEW
    for hook in _hooks():
        hook.append(settle)
    _DRAWING.append(bpy.types.SpaceView3D.draw_handler_add(_drawn, (), "WINDOW", "PRE_VIEW"))


def unregister() -> None:
    """The same backwards."""
    bpy.types.SpaceView3D.draw_handler_remove(_DRAWING.pop(), "WINDOW")
    if _ticking():
        bpy.app.timers.unregister(_tick)
    for hook in _hooks():
        hook.remove(settle)
    del bpy.types.Scene.dogsplat_follow_view, bpy.types.Scene.dogsplat_moving_count
