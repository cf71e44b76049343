"""A Mitsuba scene as a data set: each sensor is rendered with the scene's own integrator and becomes a view."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..scene.cameras import Camera
from ..scene.mitsuba_cameras import camera_from_mitsuba
from ..support.errors import DataError, interruptible
from ..support.pictures import without_aovs
from ..support.scene_errors import scene_error
from ..support.srgb import linear_to_srgb
from .dataset import Dataset, View, every_eighth, held_out, no_points, require_unique_names, views_named
from .given_cameras import sensor_name, shrunk, told
from .images import box_downscale, straight_color
from .scene_file import has_splats, load_scene


def load_mitsuba_scene(file: Path, downscale: int, spp: int, split: str = "test") -> Dataset:
    """Render every sensor of a scene XML at ``spp`` samples; every 8th sensor is test; there are no points.

    See ``held_out`` for ``split``.

    Averaging for ``downscale`` happens in linear radiance, as a film of fewer pixels would do it. Alpha is
    kept where the film has it (``pixel_format`` rgba) and it is not 1 everywhere. A Mitsuba variant must be
    set. Raises ``DataError``, also for sensors that are no pinhole, and for scenes of splats: who wants to learn
    from their pictures makes a data set of them first.
    """
    if has_splats(file):
        remedy = "render it (dogsplat render), or make a data set of its pictures (dogsplat capture)"
        raise DataError(file, "is a scene of splats, not a data set", remedy)
    scene, _ = load_scene(file)
    sensors = scene.sensors()
    if not sensors:
        raise DataError(file, "the scene has no sensor", "add a perspective sensor per view")
    names = [sensor_name(sensor.id(), i) for i, sensor in enumerate(sensors)]
    require_unique_names(file, names)
    train, test = held_out(*every_eighth(names), split)
    wanted = {*train, *test}
    shots = {name: _shot(file, scene, i, spp, downscale) for i, name in enumerate(names) if name in wanted}
    has_alpha = any(image.shape[2] == 4 and image[..., 3].min() < 1 for _, image in shots.values())
    views = [View(name, camera, _display(image, has_alpha)) for name, (camera, image) in shots.items()]
    return Dataset(file, views_named(views, train), views_named(views, test), *no_points(), has_alpha)


def _shot(file: Path, scene: Any, sensor_index: int, spp: int, downscale: int) -> tuple[Camera, np.ndarray]:
    """The camera of a sensor, and its linear picture [H, W, 3 or 4]. Raises ``DataError``."""
    sensor = scene.sensors()[sensor_index]
    which = told(sensor, sensor_index)
    try:
        camera = camera_from_mitsuba(sensor)
    except ValueError as error:
        raise DataError(file, f"{which}: {error}", "correct or remove that sensor") from error
    camera = shrunk(file, camera, which, downscale)
    try:
        linear = _render(scene, sensor_index, spp)
    except RuntimeError as error:
        raise scene_error(file, error, f"Mitsuba cannot render {which}") from error
    if not np.isfinite(linear).all():
        raise DataError(file, f"the render of {which} is not finite", "correct the scene")
    return camera, box_downscale(linear, downscale)


def _render(scene: Any, sensor_index: int, spp: int) -> np.ndarray:
    """Linear render of one sensor without its AOVs: float32 [H, W, 3], or [H, W, 4] premultiplied."""
    import mitsuba as mi

    render: Any = mi.render  # whose stubs know no number as a seed
    with interruptible():
        render(scene, sensor=sensor_index, spp=spp, seed=sensor_index)
    bitmap = without_aovs(scene.sensors()[sensor_index].film().bitmap())
    formats = mi.Bitmap.PixelFormat
    alpha = bitmap.pixel_format() in (formats.RGBA, formats.YA, formats.XYZA)
    return np.array(bitmap.convert(formats.RGBA if alpha else formats.RGB, mi.Struct.Type.Float32, False))


def _display(linear: np.ndarray, has_alpha: bool) -> np.ndarray:
    """sRGB values of a linear image; the curve is applied to straight colour, which is then premultiplied again."""
    if not has_alpha:
        return linear_to_srgb(np.clip(linear[..., :3], 0, 1))
    if linear.shape[2] == 3:
        linear = np.concatenate([linear, np.ones_like(linear[..., :1])], axis=2)
    alpha = np.clip(linear[..., 3:], 0, 1)  # [H, W, 1]
    straight = np.clip(straight_color(linear[..., :3], alpha), 0, 1)
    return np.concatenate([linear_to_srgb(straight) * alpha, alpha], axis=2).astype(np.float32)
