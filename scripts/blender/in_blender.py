"""What several of these scripts do inside of Blender."""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

ROOT = Path(__file__).resolve().parents[2]


def exact_view(model: str, camera_file: str, show_as: str) -> Any:
    """In an empty file: a model, a camera of ours and the settings of the exact picture; returns that camera."""
    sys.path.insert(0, str(ROOT))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    import addon_utils  # found once bpy is there

    addon_utils.enable("blender_addon")
    from blender_addon.cameras.camera import Camera
    from blender_addon.cameras.objects import build_camera, look_through

    scene = bpy.context.scene
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
