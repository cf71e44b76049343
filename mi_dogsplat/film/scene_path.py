"""The way of the camera through a Mitsuba scene: around what its sensor looks at, from sensor to sensor, or another."""

from __future__ import annotations

from dataclasses import replace

from ..datasets.given_cameras import auto_up, told, unmirrored
from ..datasets.scene_file import framing_sphere, load_scene
from ..render.scene_to_draw import SceneToDraw
from ..scene.cameras import Camera
from ..scene.mitsuba_cameras import central_camera_from_mitsuba
from ..scene.orientation import up_vector
from ..support.errors import DataError
from .camera_path import CameraPath
from .chosen_path import chosen_path
from .data_cameras import DataCameras
from .film_config import FilmConfig
from .orbit import Surroundings, around_camera


def path_through(drawn: SceneToDraw, data: DataCameras, config: FilmConfig) -> CameraPath:
    """The path that ``config`` names, and the size of its pictures.

    Without cameras of ``data`` it is an orbit that begins with the picture of the sensor, unless it is said to follow
    the sensors of the scene. A mirrored sensor goes without its mirror. Raises ``DataError``.
    """
    number, up = drawn.options.sensor, data.up
    up = up_vector(auto_up(drawn.scene, number)) if up is None else up
    own = _camera(drawn, number)

    def around() -> Surroundings:
        whole, _ = load_scene(drawn.file, defined=drawn.options.defined)  # where each shape has its own bounding box
        return around_camera(own, framing_sphere(drawn.file, whole)[0], up, config.fov)

    if config.path == "cameras" and not data.cameras:
        data = DataCameras(_sensors(drawn))
    path = chosen_path(config, data, up, around)
    return replace(path, size=path.size or (own.width, own.height))


def _sensors(drawn: SceneToDraw) -> list[Camera]:
    """Those of a scene, in the order of its file. Raises ``DataError`` where there is one, or one is no camera."""
    n_sensors = len(drawn.scene.sensors())
    if n_sensors < 2:
        problem = f"{drawn.file} has one sensor, which makes no path"
        raise DataError("--path", problem, "add --data DATA, or use --path orbit or key frames")
    return [_camera(drawn, number) for number in range(n_sensors)]


def _camera(drawn: SceneToDraw, number: int) -> Camera:
    sensor = drawn.scene.sensors()[number]
    try:
        return unmirrored(central_camera_from_mitsuba(sensor))
    except (KeyError, ValueError) as error:
        problem = f"{told(sensor, number)} is not a camera that a film can follow ({sensor.class_name()})"
        raise DataError(drawn.file, problem, "choose a perspective or thinlens sensor by --sensor") from error
