"""Where Blender calls the watcher: at each drawing of a viewport, by a timer, after undo, and with files."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

import bpy
import gpu
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, EnumProperty, IntProperty

from ..engine.settings import ENGINE
from .looking_through import corners_of, looked_through
from .rendered import look
from .tagged import evaluated, frame_changed
from .view import view_of
from .watcher import INTERVAL, Shown, Watcher

BEHIND_OURS = 200  # splats that Blender itself draws behind our pictures, to be clicked at
SOFTWARE = ("llvmpipe", "softpipe", "swr", "swiftshader", "basic render driver")
WAYS = (
    ("AUTOMATIC", "Automatic", "Points if the processor draws, else the most important splats"),
    ("POINTS", "Points", "The most important splats as points, in coarse pixels: for computers without a graphics "
    "card"),
    ("SHARE", "Most Important", "The most important splats, as they are shown"),
    ("ALL", "All", "All splats"),
)
PROPERTIES = {
    "dogsplat_moving": EnumProperty(
        name="While Moving", items=WAYS, default="AUTOMATIC", description="What a viewport shows while it moves"
    ),
    "dogsplat_moving_count": IntProperty(
        name="Splats While Moving",
        default=20_000,
        min=1,
        description="How many splats a moving viewport shows: the most important ones",
    ),
    "dogsplat_follow_view": BoolProperty(
        name="Follow View",
        default=False,
        description="Compute colors, and the quads of Automatic, for the viewport that moved last instead of the "
        "camera. Renders still use the camera",
        update=lambda scene, context: WATCHER.show(scene, Shown()),
    ),
}
WATCHER = Watcher()
_DRAWING: list[Any] = []


def while_moving(scene: bpy.types.Scene, renderer: str) -> Shown:
    """What a scene shows while a viewport moves that ``renderer`` draws (as OpenGL names it)."""
    way = scene.dogsplat_moving
    if way == "AUTOMATIC":
        way = "POINTS" if any(name in renderer.lower() for name in SOFTWARE) else "SHARE"
    return Shown() if way == "ALL" else Shown(scene.dogsplat_moving_count, way == "POINTS")


def at_rest(scene: bpy.types.Scene, windows: Iterable[bpy.types.Window]) -> Shown:
    """What the viewports of a scene show at rest: next to nothing where all are drawn by our own engine."""
    areas = [area for window in windows if window.scene == scene for area in window.screen.areas]
    spaces = [area.spaces.active for area in areas if area.type == "VIEW_3D"]
    return Shown(BEHIND_OURS) if spaces and all(is_ours(scene, space) for space in spaces) else Shown()


def is_ours(scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> bool:
    """Whether our engine draws a viewport."""
    return scene.render.engine == ENGINE and space.shading.type == "RENDERED"


def _drawn() -> None:
    """A viewport is drawn."""
    context = bpy.context
    scene, space, region = context.scene, context.region_data, context.region
    ours, key = space is not None and is_ours(scene, context.space_data), region.as_pointer()
    needed = WATCHER.draws(key, scene, ours) or ours  # a model may be new, or shown whole by a save
    if space is not None and not ours and (scene.dogsplat_moving != "ALL" or scene.dogsplat_follow_view):
        camera = looked_through(context)  # the original: Blender keeps in it what is on the screen
        corners = None if camera is None else corners_of(scene, camera)
        view = view_of(space, region.width, region.height, corners)
        needed |= WATCHER.see(key, scene, view, time.monotonic())
    if needed and not _ticking():
        bpy.app.timers.register(_tick, first_interval=INTERVAL)


def _ticking() -> bool:
    return bpy.app.timers.is_registered(_tick)


def _tick() -> float | None:
    renderer, windows = gpu.platform.renderer_get(), bpy.context.window_manager.windows
    return WATCHER.tick(
        time.monotonic(), lambda scene: while_moving(scene, renderer), lambda scene: at_rest(scene, windows)
    )


@persistent
def settle(*_: Any) -> None:
    """No file is saved, and none comes back, with splats left out or in coarse pixels."""
    for scene in bpy.data.scenes:
        WATCHER.show(scene, Shown())


@persistent
def loaded(*_: Any) -> None:
    """Another file, which may have been written in the middle of a movement."""
    WATCHER.forget()
    settle()


def _hooks() -> tuple[tuple[Any, Any], ...]:
    handlers = bpy.app.handlers
    changing = handlers.save_pre, handlers.undo_post, handlers.redo_post
    ours = (handlers.depsgraph_update_post, evaluated), (handlers.frame_change_post, frame_changed)
    return (handlers.load_post, loaded), *ours, *((hook, settle) for hook in changing)


def register() -> None:
    """Settings of scenes, the handlers, and the callback of viewports."""
    for name, kind in PROPERTIES.items():
        setattr(bpy.types.Scene, name, kind)
    for hook, function in _hooks():
        hook.append(function)
    _DRAWING.append(bpy.types.SpaceView3D.draw_handler_add(_drawn, (), "WINDOW", "PRE_VIEW"))


def unregister() -> None:
    """The same backwards; a viewport that moves shows all before."""
    settle()
    bpy.types.SpaceView3D.draw_handler_remove(_DRAWING.pop(), "WINDOW")
    for timer in (_tick, look):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    for hook, function in _hooks():
        hook.remove(function)
    for name in PROPERTIES:
        delattr(bpy.types.Scene, name)
