"""Key frames from JSON, for ``dogsplat film --path keys.json``.

.. code-block:: json

    {"loop": false, "up": [0, 0, 1],
     "keys": [{"time": 0, "position": [3, 0, 1], "look_at": [0, 0, 0], "fov": 40},
              {"time": 2, "position": [0, 3, 1], "look_at": [0, 0, 0]},
              {"time": 5, "position": [0, 3, 1], "rotation": [0, 0, 0, 1], "fov": 25}]}

A key is one of three: ``position`` with ``look_at``, a point; ``position`` with ``rotation``, the quaternion x, y, z, w
that turns camera axes (OpenCV: x right, y down, z forward) into those of the world; or a camera as in
``camera_file.py``, so that a list of such cameras is a path too. ``time`` is in seconds; without it keys are evenly far
apart. ``fov`` is that of the shorter side in degrees; without it, that of the key before. ``up`` is upright for
``look_at``. ``loop`` closes the path: it returns to the first key within the mean time between keys.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..datasets.camera_paths import look_at
from ..render.framing import AUTOMATIC_FOV
from ..scene.camera_file import camera_in_file
from ..scene.cameras import affine, inverse_rigid
from ..support.errors import DataError
from ..support.files import read_json
from ..support.json_values import number_in
from ..support.wording import counted
from .camera_path import CameraPath, Lens, focal_of_camera, focal_of_fov, offset_of_camera
from .splines import rotation_curve, vector_curve

FORMAT = 'write {"keys": [{"time": seconds, "position": [x, y, z], "look_at": [x, y, z], "fov": degrees}, ...]}'
LARGEST = 1e15  # number in a file: with the squares of larger ones no curve can be computed
NARROWEST = 1e-6  # degrees of a field of view
SHORTEST = 1e-6  # seconds between two keys
MOMENTS = 501  # of a way, at which the curve of its lens is looked at first
STEEPEST = 1 - 1e-6  # cosine between ``up`` and a view; beyond, nothing tells how the picture is turned


@dataclass(frozen=True, eq=False)
class Key:
    """``time`` in seconds or None, ``c2w`` [4, 4], ``focal`` over the shorter side, ``target`` [3] or None, ``size`` of
    the picture or None, ``offset`` of the principal point as a ``Lens`` has it."""

    time: float | None
    c2w: np.ndarray
    focal: float
    target: np.ndarray | None
    size: tuple[int, int] | None
    offset: tuple[float, float] = (0.0, 0.0)


def key_frames_path(path: Path, up: np.ndarray, fov: float | None) -> CameraPath:
    """The path through the key frames of a file.

    Args:
        up: [3], where the file says none.
        fov: in place of what the keys say, in degrees; None: theirs.

    Raises ``DataError`` that names the key.
    """
    content = read_json(path, FORMAT)
    whole: dict[str, Any] = content if isinstance(content, dict) else {"keys": content}
    if not isinstance(whole.get("keys"), list) or not whole["keys"]:
        raise DataError(path, "has no list of keys", FORMAT)
    loop = whole.get("loop", False)
    if not isinstance(loop, bool):
        raise DataError(path, f'"loop" is {loop!r}', "write true or false")
    upright = _upright(path, whole["up"]) if "up" in whole else up
    keys: list[Key] = []
    for i, entry in enumerate(whole["keys"]):
        try:
            keys.append(_key(entry, upright, keys[-1].focal if keys else focal_of_fov(AUTOMATIC_FOV)))
        except (ValueError, TypeError, OverflowError, KeyError) as error:
            raise DataError(path, f"key {i}: {error}", FORMAT) from error
    times = _times(path, keys)
    mean_step = (times[-1] - times[0]) / max(len(keys) - 1, 1)
    period = times[-1] - times[0] + mean_step if loop and len(keys) > 1 else None
    duration = (period or times[-1] - times[0]) if keys[0].time is not None and len(keys) > 1 else None
    way = _curves(path, keys, times, period, upright, fov)
    what = f"{'a loop ' if loop else ''}through {counted(len(keys), 'key frame')} of {path.name}"
    return CameraPath(way, loop, what, duration, keys[0].size)


def _curves(
    path: Path, keys: list[Key], times: np.ndarray, period: float | None, up: np.ndarray, fov: float | None
) -> Callable[[float], Lens]:
    """The lens at a share of the way. Where every key looks at a point, so does the camera between them.

    Raises ``DataError`` where the curve of the focal length leaves all lenses: a sudden change swings far beyond.
    """
    places = vector_curve(times, np.array([key.c2w[:3, 3] for key in keys]), period)
    zooms = vector_curve(times, np.log([[key.focal] for key in keys]), period)
    offsets = vector_curve(times, np.array([key.offset for key in keys]), period)
    targets = [key.target for key in keys if key.target is not None]
    aims = vector_curve(times, np.array(targets), period) if len(targets) == len(keys) else None
    turns = rotation_curve(times, np.array([key.c2w[:3, :3] for key in keys]), period)
    length = period or times[-1] - times[0]
    swing = max(float(np.abs(zooms(times[0] + share * length)).max()) for share in np.linspace(0, 1, MOMENTS))
    if fov is None and swing > math.log(LARGEST):
        problem = '"fov" changes too fast between two keys for a smooth curve'
        raise DataError(path, problem, "give the change more time, or make two films")

    def at(share: float) -> Lens:
        time = times[0] + share * length
        c2w = affine(turns(time), places(time))
        if aims is not None and _can_look(c2w[:3, 3], aims(time), up):
            c2w = inverse_rigid(look_at(c2w[:3, 3], aims(time), up))
        focal = float(np.exp(zooms(time)[0])) if fov is None else focal_of_fov(fov)
        x, y = offsets(time)
        return Lens(c2w, focal, (float(x), float(y)))

    return at


def _key(entry: Any, up: np.ndarray, focal: float) -> Key:
    """``up`` is upright for ``look_at``, ``focal`` what a key without ``fov`` has.

    Raises ``ValueError``, ``TypeError`` or ``KeyError`` for what is no key.
    """
    if not isinstance(entry, dict):
        raise ValueError("is not a JSON object")
    time = number_in(entry, "time") if "time" in entry else None
    if time is not None and not np.isfinite(time):
        raise ValueError('"time" is not finite')
    if time is not None and abs(time) > LARGEST:
        raise ValueError(f'"time" is beyond {LARGEST:g}')
    return _key_of_camera(time, entry) if "w2c" in entry else _key_at_position(time, entry, up, focal)


def _key_of_camera(time: float | None, entry: dict[str, Any]) -> Key:
    """As ``_key``."""
    camera = camera_in_file(entry)
    focal, offset = focal_of_camera(camera), offset_of_camera(camera)
    if abs(camera.position).max() > LARGEST or not 1 / LARGEST <= focal <= LARGEST:
        raise ValueError(f"its position is beyond {LARGEST:g}, or its focal length no length of a lens")
    if np.abs(offset).max() > LARGEST:
        raise ValueError(f"its principal point is beyond {LARGEST:g} sides of the picture")
    return Key(time, camera.c2w, focal, None, (camera.width, camera.height), offset)


def _key_at_position(time: float | None, entry: dict[str, Any], up: np.ndarray, focal: float) -> Key:
    """As ``_key``."""
    position = _numbers(entry, "position", 3)
    if ("look_at" in entry) == ("rotation" in entry):
        raise ValueError('needs "look_at" or "rotation", one of them')
    if "fov" in entry:
        degrees = number_in(entry, "fov")
        if not NARROWEST <= degrees < 180:
            raise ValueError(f'"fov" is {degrees:g}, not within {NARROWEST:g} to 180 degrees')
        focal = focal_of_fov(degrees)
    target = None
    if "look_at" in entry:
        target = _numbers(entry, "look_at", 3)
        if not _can_look(position, target, up):
            raise ValueError('"look_at" is at the position itself, or straight above or below it')
        c2w = inverse_rigid(look_at(position, target, up))
    else:
        quaternion = _numbers(entry, "rotation", 4)
        if not 0.5 < np.linalg.norm(quaternion) < 2:
            raise ValueError('"rotation" is not a unit quaternion x, y, z, w')
        c2w = affine(Rotation.from_quat(quaternion).as_matrix(), position)
    return Key(time, c2w, focal, target, None)


def _numbers(entry: dict[str, Any], name: str, count: int) -> np.ndarray:
    if name not in entry:
        raise ValueError(f'lacks "{name}"')
    try:
        values = np.array(entry[name], np.float64)
    except (ValueError, TypeError, OverflowError):
        values = np.zeros(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise ValueError(f'"{name}" is not {count} numbers')
    if abs(values).max() > LARGEST:
        raise ValueError(f'"{name}" is beyond {LARGEST:g}')
    return values


def _can_look(position: np.ndarray, target: np.ndarray, up: np.ndarray) -> bool:
    distance = float(np.linalg.norm(target - position))
    return distance > 0 and abs(float((target - position) @ up)) / distance < STEEPEST


def _upright(path: Path, value: Any) -> np.ndarray:
    try:
        up = _numbers({"up": value}, "up", 3)
    except ValueError as error:
        raise DataError(path, str(error), "write three numbers, as [0, 0, 1]") from error
    length = float(np.linalg.norm(up))
    if length == 0:
        raise DataError(path, '"up" has no direction', "write three numbers, as [0, 0, 1]")
    return up / length


def _times(path: Path, keys: list[Key]) -> np.ndarray:
    """Of each key, [K], increasing; 0, 1, 2, ... where the file says none. Raises ``DataError``."""
    given = [key.time for key in keys]
    if all(time is None for time in given):
        return np.arange(len(keys), dtype=np.float64)
    if any(time is None for time in given):
        raise DataError(path, f'key {given.index(None)} lacks "time"', "give each key its time, or none")
    times = np.array(given, np.float64)
    if late := np.flatnonzero(np.diff(times) < SHORTEST).tolist():
        raise DataError(path, f"key {late[0] + 1} is not later than the one before", "sort the keys by their times")
    return times
