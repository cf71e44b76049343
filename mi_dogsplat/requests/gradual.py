"""Paths of a scene, a few for each pixel at a time, and the mean so far."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mitsuba as mi
import numpy as np

from ..plugin.background import radiance
from ..plugin.samples import samples
from ..plugin.sensor import SensorReader
from .request import Request
from .scene_description import hides_background

STEP_SAMPLES = 8  # per pixel, between two steps


def means(
    scene: mi.Scene, sensor: mi.Sensor, request: Request, step: int = STEP_SAMPLES
) -> Iterator[tuple[int, np.ndarray]]:
    """(samples that are done, their mean [H, W, 4]: linear radiance premultiplied with alpha), to those of the request.

    step: samples from one mean to the next at least, and less than twice as many. Random numbers of one are independent
    of those of the next, and of those of other seeds. Where the scene is not to be transparent, alpha is 1.
    """
    width, height = sensor.film().crop_size()
    count, steps = request.samples, max(request.samples // step, 1)
    total, done = np.zeros((height, width, 4)), 0
    behind = _environment(scene, sensor) if hides_background(request) else None
    for number in range(steps):
        now = count * (number + 1) // steps - done
        seed: Any = int(np.random.SeedSequence((request.seed, number)).generate_state(1)[0])
        total += now * np.array(mi.render(scene, sensor=sensor, spp=now, seed=seed))[..., :4]  # [H, W, 4]
        done += now
        mean = (total / done).astype(np.float32)
        if behind is not None:
            mean[..., :3] += (1 - mean[..., 3:]) * behind
        if not request.transparent:
            mean[..., 3] = 1
        yield done, mean


def _environment(scene: mi.Scene, sensor: mi.Sensor) -> np.ndarray | None:
    """Radiance behind a scene, [H, W, 3], averaged over the pixels as far as a few places tell."""
    emitter = scene.environment()
    if emitter is None:
        return None
    (view,) = SensorReader().views(sensor, 0.0)
    looks = [view.through(sample) for sample in samples(STEP_SAMPLES)]
    size = looks[0].camera.height, looks[0].camera.width
    seen = np.mean([np.array(radiance(emitter, look.rays())) for look in looks], 0)  # [3, H W], or one number for all
    color = np.broadcast_to(seen.reshape(3, -1), (3, size[0] * size[1])).reshape(3, *size)
    return np.moveaxis(color, 0, -1)
