"""From planes of pixels to the developed image: channels and colour conversion.

Planes are row-major: 3 colours as linear radiance, alpha where the film has it, then the AOVs.
"""

from __future__ import annotations

import re
from typing import Any

import drjit as dr
import mitsuba as mi


def has_alpha(film: mi.Film) -> bool:
    """Whether the film asks for an alpha channel."""
    return mi.has_flag(film.flags(), mi.FilmFlags.Alpha)


def pixel_format_of(film: mi.Film) -> str:
    """As the plugin's parameter has it; a film shows it in its description only."""
    found = re.search(r"pixel_format = (\w+)", str(film))
    shown = found[1] if found else "rgb"
    return {"y": "luminance", "ya": "luminance_alpha"}.get(shown, shown)


def develop(film: mi.Film, aov_names: list[str], planes: list[mi.Float], derivative: bool = False) -> Any:
    """The image, a tensor, of planes that have one value per pixel, kept in the film too. Differentiable.

    ``derivative``: wanted for its graph only, the film is left as it is.
    """
    width, height = film.crop_size()
    pixel_format = pixel_format_of(film)
    as_it_is = pixel_format in ("rgb", "rgba")
    if not derivative:
        _fill(film, aov_names, planes)
    if as_it_is:  # what the film would say, without asking it: its samples have the weight 1
        return interleave(planes, height, width)
    if derivative:
        film = mi.load_dict({"type": "hdrfilm", "width": width, "height": height, "pixel_format": pixel_format})
        _fill(film, aov_names, planes)
    return film.develop()


def _fill(film: Any, aov_names: list[str], planes: list[mi.Float]) -> None:
    width, height = film.crop_size()
    film.prepare(aov_names)
    n_colors = 4 if has_alpha(film) else 3
    channels = [*planes[:n_colors], mi.Float(1), *planes[n_colors:]]  # samples of weight 1
    film.put_block(image_block(interleave(channels, height, width), film.crop_offset()))


def image_block(*args: Any, **kwargs: Any) -> Any:
    """``mi.ImageBlock``, whose stub asks for types of Dr.Jit where it takes Mitsuba's."""
    return mi.ImageBlock(*args, **kwargs)


def interleave(channels: list[mi.Float], height: int, width: int) -> mi.TensorXf:
    """Planes to a [height, width, channels] tensor. Differentiable."""
    n, k = height * width, len(channels)
    if n == 0:
        return dr.zeros(mi.TensorXf, (height, width, k))
    pixels = dr.empty(mi.Float, n * k)
    index = dr.arange(mi.UInt32, n)
    for c, channel in enumerate(channels):
        dr.scatter(pixels, channel, dr.fma(index, k, c), mode=dr.ReduceMode.Permute)
    return mi.TensorXf(pixels, shape=(height, width, k))


def side_by_side(images: list[list[mi.Float]], width: int, height: int) -> list[mi.Float]:
    """Planes of images of one size, joined from left to right. Differentiable."""
    if len(images) == 1:
        return images[0]
    index = dr.arange(mi.UInt32, width * height)
    row = index // width
    joined = []
    for planes in zip(*images, strict=True):
        plane = dr.empty(mi.Float, len(images) * width * height)
        for k, part in enumerate(planes):
            at = row * (len(images) * width) + k * width + (index - row * width)
            dr.scatter(plane, part, at, mode=dr.ReduceMode.Permute)
        joined.append(plane)
    return joined
