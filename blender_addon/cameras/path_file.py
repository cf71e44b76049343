"""Key frames of ``dogsplat film --path``: cameras with times, in the coordinates of a model."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..files.errors import FileError, told
from ..files.rotation import rotations
from .camera import Camera, require_pixels, rigid

AUTOMATIC_FOV = 40.0  # degrees of the shorter side, where no key says any: as the package has it
FORMAT = 'give {"keys": [{"time": seconds, "position": [x, y, z], "look_at": [x, y, z], "fov": degrees}, ...]}'


@dataclass(frozen=True, eq=False)
class PathKey:
    """A camera at a time in seconds; ``sized``: the file says how large its picture is."""

    time: float
    camera: Camera
    sized: bool


def read_path(path: Path, width: int, height: int, upright: np.ndarray) -> list[PathKey]:
    """The keys of a file, in order of time; ``width`` and ``height`` of pictures, and what is ``upright`` [3], where it
    does not say.

    Without times they are a second apart. Raises ``FileError`` for what ``dogsplat film`` refuses too.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise FileError(path, "cannot be read as JSON ({reason})", FORMAT, reason=error) from error
    whole: dict[str, Any] = content if isinstance(content, dict) else {"keys": content}
    entries = whole.get("keys")
    if not isinstance(entries, list) or not entries:
        raise FileError(path, "has no list of keys", FORMAT)
    up, fov = _upright(path, whole.get("up", upright)), AUTOMATIC_FOV
    keys: list[PathKey] = []
    for i, entry in enumerate(entries):
        try:
            if "w2c" in entry:
                camera = _given(path, i, entry)
                fov = _fov(camera)
            else:
                fov = float(entry.get("fov", fov))
                camera = _aimed(entry, up, fov, i, width, height)
            keys.append(PathKey(_time(entry, i), camera, "w2c" in entry))
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
            if isinstance(error, FileError):
                raise
            raise FileError(path, "key {number} cannot be used ({reason})", FORMAT, number=i, reason=error) from error
    _check_times(path, entries, keys)
    return keys


def _upright(path: Path, given: Any) -> np.ndarray:
    try:
        return _vector({"up": given}, "up", 3)
    except ValueError as error:
        raise FileError(path, "{reason}", FORMAT, reason=error) from error


def _check_times(path: Path, entries: list[dict[str, Any]], keys: list[PathKey]) -> None:
    """Raise ``FileError`` where only some keys have a time of their own, or where these do not grow."""
    lacking = [i for i, entry in enumerate(entries) if "time" not in entry]
    if lacking and len(lacking) < len(entries):
        raise FileError(path, 'key {number} lacks "time"', "give each key its time, or none", number=lacking[0])
    if any(later.time <= key.time for key, later in zip(keys, keys[1:], strict=False)):
        raise FileError(path, "its keys are not in order of time", "sort them")


def _time(entry: dict[str, Any], i: int) -> float:
    time = float(entry.get("time", i))
    if not math.isfinite(time):
        raise ValueError('"time" is not finite')
    return time


def _given(path: Path, i: int, entry: dict[str, Any]) -> Camera:
    fx, width, height = (float(entry[name]) for name in ("fx", "width", "height"))
    fy, cx, cy = (float(entry.get(name, own)) for name, own in (("fy", fx), ("cx", width / 2), ("cy", height / 2)))
    size = int(width), int(height)  # of what is no number, ValueError and OverflowError
    if size != (width, height) or min(fx, fy, *size) <= 0 or not np.isfinite((fx, fy, cx, cy)).all():
        raise ValueError("its lengths in pixels fit no camera")
    require_pixels(cx, cy, *size)
    return Camera(f"key {i}", rigid(path, f"key {i}", entry["w2c"]), fx, fy, cx, cy, *size)


def _fov(camera: Camera) -> float:
    """Degrees of the shorter side."""
    return 2 * math.degrees(math.atan(min(camera.width, camera.height) / (2 * math.sqrt(camera.fx * camera.fy))))


def _aimed(entry: dict[str, Any], up: np.ndarray, fov: float, i: int, width: int, height: int) -> Camera:
    if not 0 < fov < 180:
        raise ValueError(told('"fov" is {fov:g}, not within 0 to 180 degrees', fov=fov))
    c2w = np.eye(4)
    c2w[:3, 3] = _vector(entry, "position", 3)
    if "look_at" in entry:
        c2w[:3, :3] = _turned_to(_vector(entry, "look_at", 3) - c2w[:3, 3], up)
    else:
        c2w[:3, :3] = _rotation(_vector(entry, "rotation", 4))
    focal = min(width, height) / (2 * math.tan(math.radians(fov) / 2))
    return Camera(f"key {i}", np.linalg.inv(c2w), focal, focal, width / 2, height / 2, width, height)


def _vector(entry: dict[str, Any], name: str, count: int) -> np.ndarray:
    try:
        values = np.array(entry[name], np.float64)
    except (ValueError, TypeError):
        values = np.zeros(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise ValueError(told('"{name}" is not {count} numbers', name=name, count=count))
    return values


def _turned_to(forward: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Axes of a camera, OpenCV's, as columns."""
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-9 * np.linalg.norm(forward):
        raise ValueError('"look_at" is at the position itself, or straight above or below it')
    axes = [right, np.cross(forward, right), forward]
    return np.stack([axis / np.linalg.norm(axis) for axis in axes], axis=1)


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    """[3, 3] of x, y, z, w."""
    length = np.linalg.norm(quaternion)
    if not 0.5 < length < 2:
        raise ValueError('"rotation" is not a unit quaternion x, y, z, w')
    return rotations(quaternion[None, [3, 0, 1, 2]] / length)[0]
