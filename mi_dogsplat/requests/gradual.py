"""Paths of a scene, a few for each pixel at a time, and the mean so far."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import mitsuba as mi
import numpy as np

from ..plugin.background import radiance
from ..plugin.samples import samples
from ..plugin.sensor import SensorReader

BEHIND_SAMPLES = 8  # places in a pixel through which its background is looked at


def means(
    scene: mi.Scene, sensor: mi.Sensor, steps: Sequence[int], seed: int, with_background: bool
) -> Iterator[tuple[int, np.ndarray]]:
    """(samples that are done, their mean [H, W, 4]: linear radiance premultiplied with alpha) after each step.

    steps: samples for each pixel between two means. with_background: the environment is put behind what has been
    rendered without.
    """
    width, height = sensor.film().crop_size()
    total, done = np.zeros((height, width, 4)), 0
    behind = environment(scene, sensor) if with_background else None
    for count in steps:
        place: Any = seed + done
        total += count * np.array(mi.render(scene, sensor=sensor, spp=count, seed=place))[..., :4]  # [H, W, 4]
        done += count
        mean = (total / done).astype(np.float32)
        if behind is not None:
            mean += (1 - mean[..., 3:]) * behind
        yield done, mean


def in_steps(count: int, first: int, most: int) -> list[int]:
    """``count`` samples as one step of ``first`` and others of ``most``."""
    rest = max(count - first, 0)
    return [min(first, count), *[most] * (rest // most), *[rest % most][: rest % most]]


def environment(scene: mi.Scene, sensor: mi.Sensor) -> np.ndarray | None:
    """What is behind a scene, [H, W, 4] with alpha 1, averaged over the pixels as far as a few places tell."""
    emitter = scene.environment()
    if emitter is None:
        return None
    (view,) = SensorReader().views(sensor, 0.0)
    looks = [view.through(sample) for sample in samples(BEHIND_SAMPLES)]
    size = looks[0].camera.height, looks[0].camera.width
    seen = np.mean([np.array(radiance(emitter, look.rays())) for look in looks], 0)  # [3, H W], or one number for all
    color = np.broadcast_to(seen.reshape(3, -1), (3, size[0] * size[1])).reshape(3, *size)
    return np.concatenate([np.moveaxis(color, 0, -1), np.ones((*size, 1))], -1)
