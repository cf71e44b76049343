"""Pictures of ``dogpath`` without their noise, by Open Image Denoise (docs/dogpath.md, *Denoising*).

The package ``mitsuba-oidn`` is imported where it is used: it comes with the extra ``denoise``.
"""

from __future__ import annotations

from collections.abc import Sequence
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

    Open Image Denoise smoothes what light paths brought. What the splats in front of the camera show stays as it is. It
    looks for edges in albedo and normal, from which it takes the noise first. It runs on the CPU, so that every machine
    makes the same picture.

    Args:
        image: [H, W, C], of a film of RGB or RGBA: linear radiance. Not changed.
        channels: names of its last channels, as ``integrator.aov_names()`` tells them.

    Returns [H, W, C - 9], float32. Raises ``ValueError`` where the AOV is not among the channels, and
    ``ModuleNotFoundError`` where ``mitsuba_oidn`` is not installed.
    """
    if missing := [name for name in CHANNELS if name not in channels]:
        raise ValueError(f'the channel {missing[0]} is missing; name "{AOV}" in the "aovs" of the integrator dogpath')
    image = np.asarray(image, np.float32)
    first = image.shape[-1] - len(channels)
    at = [first + list(channels).index(name) for name in CHANNELS]
    paths, albedo, normal = (np.ascontiguousarray(image[..., at[k : k + 3]]) for k in (0, 3, 6))
    light = np.maximum(paths, 0)  # below it lies what negative lobes take from what is behind: that stays
    guides = {"albedo": _filtered({"albedo": albedo}), "normal": _filtered({"normal": normal})}
    smooth = _filtered({"color": light, **guides}, hdr=True, clean_aux=True)
    result = undenoised(image, channels)
    result[..., :3] += smooth - light
    return result


def undenoised(image: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """The same render [H, W, C - 9] as it is."""
    first = image.shape[-1] - len(channels)
    return np.delete(image, [first + k for k, name in enumerate(channels) if name in CHANNELS], -1)


def _filtered(images: dict[str, np.ndarray], **settings: bool) -> np.ndarray:
    """By a filter of Open Image Denoise, [H, W, 3]."""
    import mitsuba_oidn as oidn

    out = np.zeros_like(next(iter(images.values())))
    chosen = oidn.Device(oidn.DeviceType.CPU).new_filter("RT")
    for name, image in {**images, "output": out}.items():
        chosen.set_image(name, image)
    for name, value in settings.items():
        setattr(chosen, name, value)
    chosen.execute()
    return out
