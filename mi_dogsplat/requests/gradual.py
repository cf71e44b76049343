"""Paths of a scene, a few for each pixel at a time, and the mean so far."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mitsuba as mi
import numpy as np

from ..plugin.background import radiance
from ..plugin.samples import samples
from ..plugin.sensor import SensorReader

STEP_SAMPLES = 8  # per pixel, between two steps


def means(
    scene: mi.Scene, sensor: mi.Sensor, count: int, seed: int, with_background: bool, step: int = STEP_SAMPLES
) -> Iterator[tuple[int, np.ndarray]]:
    """(samples that are done, their mean [H, W, 4]: linear radiance premultiplied with alpha), ``count`` at the end.

    with_background: the environment is put behind what has been rendered without. step: samples between two means.
    """
    width, height = sensor.film().crop_size()
    total, done = np.zeros((height, width, 4)), 0
    behind = environment(scene, sensor) if with_background else None
    while done < count:
        now = min(step, count - done)
        place: Any = seed + done
        total += now * np.array(mi.render(scene, sensor=sensor, spp=now, seed=place))[..., :4]  # [H, W, 4]
        done += now
        mean = (total / done).astype(np.float32)
        if behind is not None:
            mean += (1 - mean[..., 3:]) * behind
        yield done, mean


def environment(scene: mi.Scene, sensor: mi.Sensor) -> np.ndarray | None:
    """What is behind a scene, [H, W, 4] with alpha 1, averaged over the pixels as far as a few places tell."""
    emitter = scene.environment()
    if emitter is None:
        return None
    (view,) = SensorReader().views(sensor, 0.0)
    looks = [view.through(sample) for sample in samples(STEP_SAMPLES)]
    size = looks[0].camera.height, looks[0].camera.width
    seen = np.mean([np.array(radiance(emitter, look.rays())) for look in looks], 0)  # [3, H W], or one number for all
    color = np.broadcast_to(seen.reshape(3, -1), (3, size[0] * size[1])).reshape(3, *size)
    return np.concatenate([np.moveaxis(color, 0, -1), np.ones((*size, 1))], -1)
