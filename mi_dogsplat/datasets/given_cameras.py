"""Cameras that are given: the sensors of a Mitsuba scene, or a JSON list; and which way is up for the first."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.camera_file import FORMAT, camera_in_file
from ..scene.cameras import Camera
from ..scene.mitsuba_cameras import SQUARE_TOLERANCE, camera_from_mitsuba
from ..support.errors import DataError, Wrong
from ..support.files import read_json
from .camera_paths import FAR, Shot
from .dataset import require_unique_names

NEAR = 1e-8  # clipping distance, times the size of a scene with all of its sky: float32 can tell no less there


def sensor_shots(path: Path, scene: Any, downscale: int) -> list[Shot]:
    """A shot per sensor of a Mitsuba scene, named by its id. Raises ``DataError`` for what is no pinhole.

    A mirrored sensor gives the picture that it shows mirrored: data sets have no mirrored cameras.
    """
    import mitsuba as mi

    sensors = scene.sensors()
    if not sensors:
        raise DataError(path, "the scene has no sensor", "add perspective sensors, or use another --path")
    shots = []
    for i, sensor in enumerate(sensors):
        try:
            if any(name.startswith("medium.") for name, _ in mi.traverse(sensor)):
                raise ValueError("it stands in a medium, which a capture would leave out")
            camera = unmirrored(camera_from_mitsuba(sensor))
        except ValueError as error:
            remedy = "only perspective sensors outside of media can be captured: change or remove it"
            problem = error.problem if isinstance(error, Wrong) else str(error)  # the remedy is another one here
            raise DataError(path, f"{told(sensor, i)}: {problem}", remedy) from error
        camera = shrunk(path, camera, told(sensor, i), downscale)
        shots.append(Shot(sensor_name(sensor.id(), i), camera, float(sensor.near_clip()), float(sensor.far_clip())))
    require_unique_names(path, [shot.name for shot in shots])
    return shots


def sensor_name(sensor_id: str, index: int) -> str:
    """The sensor's id as a file name; Mitsuba's own ids of unnamed objects (``_unnamed_3``) give way to the index."""
    named = sensor_id and not sensor_id.startswith("_unnamed")
    return re.sub(r"[^\w.-]", "_", sensor_id) if named else f"sensor_{index:03d}"


def told(sensor: Any, index: int) -> str:
    """What a message calls a sensor of a scene."""
    return f'sensor "{sensor.id() or index}"'


def shrunk(path: Path, camera: Camera, which: str, downscale: int) -> Camera:
    """The camera of the smaller image. Raises ``DataError`` that says ``which`` of the file has too few pixels."""
    try:
        return camera.downscaled(downscale)
    except ValueError as error:
        raise DataError(path, f"{which}: {error}", "choose a smaller downscale factor") from error


def unmirrored(camera: Camera) -> Camera:
    """The camera whose picture is that of a mirrored one, mirrored; any other as it is."""
    if np.linalg.det(camera.w2c[:3, :3]) > 0:
        return camera
    w2c = np.diag([-1.0, 1.0, 1.0, 1.0]) @ camera.w2c
    return Camera(w2c, camera.fx, camera.fy, camera.width - camera.cx, camera.cy, camera.width, camera.height)


def listed_shots(path: Path, extent: float, downscale: int) -> list[Shot]:
    """A shot per camera of a JSON list, each as in ``camera_file.py``, with a ``name`` where it has one.

    ``extent`` is the size of the scene, for the clipping distance. Raises ``DataError`` that names the camera.
    """
    content = read_json(path, f"{FORMAT} for each, in a JSON list")
    if not isinstance(content, list) or not content:
        raise DataError(path, "is not a list of cameras", f"{FORMAT} for each, in a JSON list")
    shots = []
    for i, entry in enumerate(content):
        try:
            camera = _square(camera_in_file(entry))
        except (ValueError, TypeError, OverflowError, KeyError) as error:
            raise DataError(path, f"camera {i}: {error}", FORMAT) from error
        camera = shrunk(path, camera, f"camera {i}", downscale)
        named = entry.get("name") not in (None, "")  # what programs write for a camera that has no name
        name = re.sub(r"[^\w.-]", "_", str(entry["name"])) if named else f"{i:03d}"
        shots.append(Shot(name, camera, NEAR * extent, FAR))
    require_unique_names(path, [shot.name for shot in shots])
    return shots


def _square(camera: Camera) -> Camera:
    """The camera that Mitsuba can render, whose pixels are square. Raises ``ValueError`` where they are far from it."""
    if abs(camera.fx / camera.fy - 1) > SQUARE_TOLERANCE:
        raise ValueError(f"fx={camera.fx:g} and fy={camera.fy:g} differ, but pixels of a Mitsuba sensor are square")
    focal = math.sqrt(camera.fx * camera.fy)
    return Camera(camera.w2c, focal, focal, camera.cx, camera.cy, camera.width, camera.height)


def auto_up(scene: Any, number: int = 0) -> str:
    """The vertical of a scene as the sensor of this ``number`` in its file has it: an axis across the horizontal of its
    picture; ``z`` without one.

    A camera held level has its horizontal across the vertical, however steeply it looks down.
    """
    import mitsuba as mi

    if not scene.sensors():
        return "z"
    to_world: Any = mi.traverse(scene.sensors()[number])
    if "to_world" not in to_world:
        return "z"
    pose = np.array(to_world["to_world"].matrix, dtype=np.float64).reshape(4, 4)
    horizontal, vertical = pose[:3, 0], pose[:3, 1]  # [3] each
    level = np.abs(horizontal) < 1e-3 * np.linalg.norm(horizontal)  # [3] axes across the picture's horizontal
    axis = int(np.argmax(np.abs(vertical) * (level if level.any() else 1)))
    return ("-" if vertical[axis] < 0 else "") + "xyz"[axis]
