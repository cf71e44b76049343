"""Pictures of ``dogpath`` without their noise, by Open Image Denoise (docs/dogpath.md, *Denoising*).

The package ``mitsuba-oidn`` is imported where it is used: it comes with the extra ``denoise``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec

import numpy as np

from ..plugin.denoising import AOV, CHANNELS
from ..support.errors import DataError


def require_denoiser(source: str) -> None:
    """Raise ``DataError`` where Open Image Denoise, which ``source`` asks for, is not installed."""
    if find_spec("mitsuba_oidn") is None:
        raise DataError(source, "needs the package mitsuba-oidn", "pip install 'mi_dogsplat[denoise]', or leave it out")


def denoised(image: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """A render with the AOV ``denoising``, smoothed, and without the channels of that AOV.

    Args:
        image: [H, W, C], of a film of RGB or RGBA: linear radiance. Not changed.
        channels: names of its last channels, as ``integrator.aov_names()`` tells them.

    Returns [H, W, C - 9], float32. Raises ``ValueError`` where the AOV is not among the channels, and
    ``ModuleNotFoundError`` where ``mitsuba_oidn`` is not installed.
    """
    result, given = parted(image, channels)
    result[..., :3] += correction(given)
    return result


def parted(image: np.ndarray, channels: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """A render as it is, [H, W, C - 9], and what a denoiser is given, [H, W, 9]. Arguments as of ``denoised``."""
    if missing := [name for name in CHANNELS if name not in channels]:
        raise ValueError(f'the channel {missing[0]} is missing; name "{AOV}" in the "aovs" of the integrator dogpath')
    image = np.asarray(image, np.float32)
    first = image.shape[-1] - len(channels)
    at = [first + list(channels).index(name) for name in CHANNELS]
    return np.delete(image, at, -1), image[..., at]


def correction(given: np.ndarray, goes_on: Callable[[], bool] = lambda: True) -> np.ndarray:
    """What is to be added to the colours of a render, [H, W, 3], so that they have no noise.

    Open Image Denoise smooths what light paths brought. What the splats in front of the camera show stays as it is. It
    looks for edges in albedo and normal, from which it takes the noise first. It runs on the CPU, whether or not there
    is a GPU.

    Args:
        given: [H, W, 9], as ``CHANNELS`` has it.
        goes_on: asked again and again whether the result is still wanted. Where it is not, nothing is added.
    """
    paths, albedo, normal = (np.ascontiguousarray(given[..., k : k + 3], np.float32) for k in (0, 3, 6))
    light = np.maximum(paths, 0)  # below it lies what negative lobes take from what is behind: that stays
    albedo, normal = _filtered({"albedo": albedo}, goes_on), _filtered({"normal": normal}, goes_on)
    smooth = _filtered({"color": light, "albedo": albedo, "normal": normal}, goes_on, hdr=True, clean_aux=True)
    return smooth - light if goes_on() else np.zeros_like(light)


def _filtered(images: dict[str, np.ndarray], goes_on: Callable[[], bool], **settings: bool) -> np.ndarray:
    """By a filter of Open Image Denoise, [H, W, 3]; unfinished where it does not go on."""
    import mitsuba_oidn as oidn

    out = np.zeros_like(next(iter(images.values())))
    chosen = oidn.Device(oidn.DeviceType.CPU).new_filter("RT")
    for name, image in {**images, "output": out}.items():
        chosen.set_image(name, image)
    for name, value in settings.items():
        setattr(chosen, name, value)
    chosen.set_progress_monitor(lambda share: goes_on())
    try:
        chosen.execute()
    except oidn.Error as error:
        if error.code != oidn.ErrorCode.Cancelled:
            raise
    return out
