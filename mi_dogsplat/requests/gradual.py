"""Paths of a scene, a few for each pixel at a time, and the mean so far."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

from ..plugin.background import radiance
from ..plugin.samples import samples
from ..plugin.sensor import SensorReader
from ..render.denoise import parted
from ..support.errors import interruptible
from .request import Request
from .scene_description import hides_background

BEHIND_SAMPLES = 8  # places in a pixel through which its background is looked at


class Mean(NamedTuple):
    """Of the samples that are done."""

    done: int
    picture: np.ndarray  # [H, W, 4]: linear radiance premultiplied with alpha
    for_denoiser: np.ndarray | None  # [H, W, 9], where the request asks for a denoiser


def means(scene: mi.Scene, sensor: mi.Sensor, request: Request, steps: Sequence[int], part: int = 0) -> Iterator[Mean]:
    """The mean after each step.

    steps: samples for each pixel between two means. part: of the picture, where the sensor sees no more of it. Random
    numbers are independent of those of other parts and seeds, and of other steps or, of our integrators, as even over
    all steps as over those of one render.
    """
    total, done = np.zeros(1), 0  # in double precision
    behind = _environment(scene, sensor) if hides_background(request) else None
    integrator: Any = scene.integrator()
    ours = hasattr(integrator, "first_pass")  # its class is another one after each change of the variant
    for number, count in enumerate(steps):
        seed: Any = int(np.random.SeedSequence((request.seed, part, 0 if ours else number)).generate_state(1)[0])
        with interruptible(), _going_on(integrator, done) if ours else nullcontext():
            total = total + count * np.array(mi.render(scene, sensor=sensor, spp=count, seed=seed))
        done += count
        image, given = (total / done).astype(np.float32), None
        if request.denoise:
            image, given = parted(image, integrator.aov_names())
        yield Mean(done, finished(image, request, behind), given)


@contextmanager
def _going_on(integrator: Any, done: int) -> Iterator[None]:
    """Renders within have the passes that follow those that are done."""
    integrator.first_pass = done
    try:
        yield
    finally:
        integrator.first_pass = None


def finished(image: np.ndarray, request: Request, behind: np.ndarray | None = None) -> np.ndarray:
    """[H, W, 4] of an image [H, W, 4 or 5] of the film, over what is behind it; where the scene is not to be
    transparent, alpha is 1. The fifth channel is the share of holdouts, which have neither background nor alpha."""
    color, alpha = image[..., :3], image[..., 3:4]
    if behind is not None:
        color = color + (1 - alpha) * behind
    if not request.transparent:
        alpha = np.ones_like(alpha)
    return np.concatenate([color, alpha - image[..., 4:] if image.shape[-1] > 4 else alpha], -1)


def in_steps(count: int, least: int, first: int = 0) -> list[int]:
    """``count`` samples: ``first`` of them, then steps of nearly one size, ``least`` or up to twice as many."""
    rest = max(count - first, 0)
    n = max(rest // least, 1)
    return [size for size in (count - rest, *np.diff(np.arange(n + 1) * rest // n).tolist()) if size]


def _environment(scene: mi.Scene, sensor: mi.Sensor) -> np.ndarray | None:
    """Radiance behind a scene, [H, W, 3], averaged over the pixels as far as a few places tell."""
    emitter = scene.environment()
    if emitter is None:
        return None
    (view,) = SensorReader().views(sensor, 0.0)
    passes = [view.through(sample) for sample in samples(BEHIND_SAMPLES)]
    size = passes[0].camera.height, passes[0].camera.width
    seen = np.mean([np.array(radiance(emitter, one.rays())) for one in passes], 0)  # [3, H W], or one number for all
    color = np.broadcast_to(seen.reshape(3, -1), (3, size[0] * size[1])).reshape(3, *size)
    return np.moveaxis(color, 0, -1)
