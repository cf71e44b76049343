"""Which way the camera of a film goes: the one that is asked for, or what suits the cameras that are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..formats.model import Model
from ..support.errors import DataError
from .camera_path import CameraPath
from .data_cameras import DataCameras
from .data_path import cameras_path
from .film_config import FilmConfig
from .key_frames import key_frames_path
from .orbit import Surroundings, around_cameras, orbit, stand_all_around
from .usd_path import is_usd_path, usd_path


def chosen_path(
    config: FilmConfig,
    data: DataCameras,
    up: np.ndarray,
    around: Callable[[], Surroundings],
    note: str = "",
    model: Model | None = None,
) -> CameraPath:
    """The path that ``config`` names.

    Args:
        data: whose cameras, if there are any, a path follows or stands on.
        up: the vertical [3].
        around: what an orbit goes around where there are no cameras; ``note`` is said of such a one.
        model: what is filmed, to which a stage of OpenUSD has a place; None: a scene, which has its coordinates.

    Raises ``DataError``.
    """
    cameras = data.cameras
    if config.path.lower().endswith(".json"):
        return key_frames_path(Path(config.path), up, config.fov)
    if is_usd_path(config.path):
        return usd_path(config.path, model, config.fov)
    if config.path == "cameras" and not cameras:
        raise DataError("--path", "no data set tells where the cameras are", "add --data DATA, or use --path orbit")
    if config.path == "cameras" or (config.path == "auto" and cameras and not stand_all_around(cameras, up)):
        config.require_for("cameras")
        return cameras_path(data.followed, config)
    config.require_for("orbit")
    if cameras:
        return orbit(around_cameras(cameras, up, config.fov), config)
    path = orbit(around(), config)
    return replace(path, what=f"{path.what} ({note})") if note else path
