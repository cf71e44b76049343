"""A Mitsuba scene as frames of a film: the scene's own integrator draws them, and one of its sensors moves."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..datasets.scene_digests import scene_digests
from ..plugin.denoising import CHANNELS
from ..render.scene_picture import channels_of, shown
from ..render.scene_to_draw import SceneToDraw, channel_names, pixels_of
from ..scene.cameras import Camera
from ..scene.mitsuba_cameras import opencv_w2c_to_mitsuba_c2w
from ..support.errors import DataError
from ..support.pictures import write_channels

MOVED = ("to_world", "x_fov", "film.size", "film.crop_size", "film.crop_offset")  # parameters of a sensor that can go
SQUARES = "m2_"  # before the name of a channel: the mean of its squares, of an integrator ``moment``
OFF_CENTRE = 1e-6  # of a picture's side: a principal point that is so near to the middle is there


class SceneFrames:
    """``Frames`` of a scene.

    Its sensor keeps what a camera does not say: clipping distances, aperture and focus, and of the film everything but
    the size. Frames have random numbers of their own, unless they are denoised: then what is left of the noise flickers
    less if they have the same. Raises ``DataError`` for a sensor that cannot be moved.
    """

    def __init__(self, drawn: SceneToDraw):
        self._drawn = drawn
        self._parameters: Any = mi.traverse(drawn.sensor)
        if any(name not in self._parameters for name in MOVED):
            remedy = "choose a perspective or thinlens sensor, with a film hdrfilm, by --sensor"
            raise DataError(drawn.file, f"its sensor {drawn.options.sensor} cannot go along a path", remedy)

    def image(self, number: int, cameras: Sequence[Camera], goes_on: Callable[[], None]) -> np.ndarray:
        """sRGB values [H, W, 3] of the colours."""
        return np.clip(shown(self._bitmap(number, cameras, goes_on), self._drawn.file), 0, 1)

    def write_exr(self, file: Path, number: int, cameras: Sequence[Camera], goes_on: Callable[[], None]) -> None:
        """Linear radiance, and every other channel of the film."""
        write_channels(file, channels_of(self._bitmap(number, cameras, goes_on)))

    def settings(self) -> dict[str, Any]:
        """The scene, and how it is drawn."""
        options = self._drawn.options
        return {**scene_digests(self._drawn.file, options.defined), **asdict(options)}

    def _bitmap(self, number: int, cameras: Sequence[Camera], goes_on: Callable[[], None]) -> Any:
        """The ``mi.Bitmap`` of an exposure: the mean of what its cameras see, and what has none at its middle."""
        first = 0 if self._drawn.options.denoise else number * len(cameras)
        total: Any = 0.0
        bitmap: Any = None
        middle: Any = None
        for moment, camera in enumerate(cameras):
            self._place(camera)
            bitmap = self._drawn.rendered(lambda done, n: goes_on(), first + moment)
            total = total + pixels_of(bitmap)
            middle = pixels_of(bitmap) if moment == len(cameras) // 2 else middle
        names = channel_names(bitmap)
        mean = np.where([_adds_up(name, names) for name in names], total / len(cameras), middle)
        return self._drawn.without_noise(mi.Bitmap(mean, bitmap.pixel_format(), names))

    def _place(self, camera: Camera) -> None:
        """Let the sensor see what a camera sees. Raises ``DataError``."""
        width, height = camera.width, camera.height
        offset = 0.5 - camera.cx / width, 0.5 - camera.cy / height
        parameters = self._parameters
        if "principal_point_offset_x" in parameters:
            parameters["principal_point_offset_x"], parameters["principal_point_offset_y"] = offset
        elif max(map(abs, offset)) > OFF_CENTRE:
            problem = "its principal points are shifted, and no thinlens sensor has that"
            raise DataError("--path", problem, "use a perspective sensor, or keys without cx and cy")
        parameters["x_fov"] = math.degrees(2 * math.atan(0.5 * width / camera.fx))
        parameters["to_world"] = mi.Transform4f(opencv_w2c_to_mitsuba_c2w(camera.w2c))
        parameters["film.size"] = parameters["film.crop_size"] = [width, height]
        parameters["film.crop_offset"] = [0, 0]
        parameters.update()


def _adds_up(channel: str, names: Sequence[str]) -> bool:
    """Whether the mean of a channel, one of these, is what a shutter lets through: of light and coverage it is, of what
    a denoiser is given, and of the moments of an integrator ``moment``, which are of light. Others, such as depths and
    numbers of primitives, have a point in their name and a last part that is no letter of a colour: a mean of them may
    be that of no surface at all."""
    _, point, part = channel.rpartition(".")
    of_moments = channel.startswith(SQUARES) or SQUARES + channel in names
    return not point or part in "RGBA" or channel in CHANNELS or of_moments
