"""Regions of a scene in which splats and surfaces light each other, as masks of its truth."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from .error_table import display

BEYOND = 0.02  # sRGB: less than this is no image in mirror or glass
SHADE = 0.9  # of the light that the floor has without the model
OWN = ("floor", "mirror", "glass", "foot", "board_front", "board_back")  # shapes of the scenes
SHOWING = {"mirror": "mirror image", "glass": "glass", "metal": "metal"}  # shapes in which the model shows


def regions(
    truth: Any, shown: np.ndarray, alone: np.ndarray, size: tuple[int, int], own: tuple[str, ...] = OWN
) -> dict[str, np.ndarray]:
    """Masks [H, W]; ``shown`` and ``alone`` are the truth and the scene without the model, linear.

    ``own``: shapes of the scene; all others of the truth are the model.
    """
    width, height = size
    index = dr.arange(mi.UInt32, width * height)
    x, y = mi.Float(index % width), mi.Float(index // width)
    at: Any = mi.Point2f((x + 0.5) / width, (y + 0.5) / height)
    ray, _ = truth.sensors()[0].sample_ray(0, 0, at, mi.Point2f(0.5))
    met = truth.ray_intersect(ray)
    first = {name: np.zeros((height, width), bool) for name in own}
    for shape in truth.shapes():
        if shape.id() in first:
            mask = met.is_valid() & (met.shape == mi.ShapePtr(shape))
            first[shape.id()] = mask.numpy().reshape(height, width)
    other = met.is_valid().numpy().reshape(height, width) & ~np.logical_or.reduce(list(first.values()))
    differs = np.abs(display(shown) - display(alone)).mean(-1) > BEYOND
    shade = shown.mean(-1) < SHADE * alone.mean(-1)
    images = {name: first[shape] & differs for shape, name in SHOWING.items() if shape in own}
    return {"model": other, "shadow": first["floor"] & shade, **images, "all": np.ones((height, width), bool)}
