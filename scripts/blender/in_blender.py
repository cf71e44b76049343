"""What several of these scripts do inside of Blender."""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Iterator, Sized
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Quaternion

ROOT = Path(__file__).resolve().parents[2]


def empty_file(command: str | None = None) -> bpy.types.Scene:
    """Its scene, with the add-on that ``sys.path`` finds, in whose preferences ``command`` starts the package."""
    import addon_utils  # found once bpy is there

    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("blender_addon", default_set=command is not None)  # only then it has preferences
    if command is not None:
        bpy.context.preferences.addons["blender_addon"].preferences.command = command
    return bpy.context.scene


def empty_studio(command: str) -> bpy.types.Scene:
    """An empty file as in `empty_file`; what the add-on's checks build their scenes of can be imported from then on."""
    sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "blender" / "helpers")]
    return empty_file(command)


def exact_view(model: str, camera_file: str, show_as: str) -> Any:
    """In an empty file: a model, a camera of ours and the settings of the exact picture; returns that camera."""
    sys.path.insert(0, str(ROOT))
    scene = empty_file()
    from blender_addon.cameras.camera import Camera
    from blender_addon.cameras.objects import build_camera, look_through

    values = json.loads(Path(camera_file).read_text())
    camera = Camera("view", np.array(values.pop("w2c")), **values)
    look_through(scene, build_camera(scene.collection, camera, Matrix.Identity(4), "", False))
    bpy.ops.import_scene.dogsplat(filepath=model, show_as=show_as)
    bpy.ops.dogsplat.exact_settings()
    return camera


def render_to(out: str, engine: str) -> None:
    """The picture of the scene by an engine, as a PNG file."""
    scene = bpy.context.scene
    scene.render.engine = engine
    scene.render.image_settings.file_format, scene.render.filepath = "PNG", out
    bpy.ops.render.render(write_still=True)


def viewport() -> tuple[bpy.types.Area, bpy.types.SpaceView3D]:
    """That of the window."""
    area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
    return area, area.spaces.active


def import_into_view(model: str) -> None:
    """Import a model, frame it in the viewport, and print what is timed there."""
    window, (area, _) = bpy.context.window_manager.windows[0], viewport()
    region = next(r for r in area.regions if r.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.import_scene.dogsplat("EXEC_DEFAULT", True, filepath=model)
        bpy.ops.view3d.view_selected()
    print(f"Blender {bpy.app.version_string}, {len(bpy.context.object.data.vertices):,} splats, viewport "
          f"{region.width}x{region.height}, {len(os.sched_getaffinity(0))} cores", flush=True)  # fmt: skip


def turn_view(angle: float, drawn: Sized) -> Iterator[float]:
    """Turn the viewport about z by so many radians, until it is drawn: ``drawn`` grows with each redraw."""
    area, space = viewport()
    space.region_3d.view_rotation = Quaternion((0, 0, 1), angle) @ space.region_3d.view_rotation
    area.tag_redraw()
    before = len(drawn)
    while len(drawn) == before:
        yield 0.0


def step_by_step(steps: Iterator[float]) -> None:
    """Go on by a timer, after as many seconds as each step says; Blender ends after the last, or the first error."""

    def tick() -> float | None:
        try:
            return next(steps)
        except StopIteration:
            os._exit(0)  # quitting asks whether to save
        except BaseException:
            traceback.print_exc()
            os._exit(1)

    bpy.app.timers.register(tick, first_interval=1, persistent=True)
