"""Which primitives of a model its training views have seen, which are of what is masked there, and which float in space
that they see through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..datasets.dataset import View
from ..datasets.masks import Masks
from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..engine.parameters import upload
from ..render.picture import picture_of
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.shifts import seen_from
from ..scene.splats import Array, Splats
from ..scores.weights import Weights, weights
from .regions import deviations_along

FREE_VIEWS = 3  # at least so many views look through a place that is free
SUPPORT = 0.1  # of the views that say something about a place; fewer have a surface there
DEPTH_SHARE = 0.15  # of the depth of a surface: what lies so near in front of it belongs to it
DEVIATIONS = 3.0  # of a primitive along the ray, likewise


def weights_in(
    splats: Splats, cameras: Sequence[Camera], drawn: DrawnAs, planes: Sequence[Array] | None = None
) -> Weights:
    """How much the primitives weigh in what cameras see of a model; ``planes`` [H, W] as ``weights`` takes them."""
    devices = [DeviceCamera.upload(camera, drawn.near_clip) for camera in cameras]
    options = RasterOptions(sh_degree=splats.sh_degree, antialiased=drawn.antialiased)
    return weights(upload(splats), devices, options, planes)


def seen(splats: Splats, cameras: Sequence[Camera], drawn: DrawnAs) -> Array:
    """[N] bool, what is blended into some pixel of some view: without the others all these views have the same bits."""
    return weights_in(splats, cameras, drawn).pixels > 0


def within_masks(splats: Splats, views: Sequence[View], masks: Masks, drawn: DrawnAs) -> Array:
    """[N] bool, what has more than half of its blending weight in white pixels; views without a mask tell nothing."""
    painted = [(view, mask) for view in views if (mask := masks.of(view)) is not None]
    found = weights_in(splats, [view.camera for view, _ in painted], drawn, [mask for _, mask in painted])
    return found.weighted > 0.5 * found.total


@dataclass(frozen=True)
class Evidence:
    """In how many views a primitive lies in front of the surface that is seen there, and in how many on it, [N]."""

    free: Array
    on: Array

    @property
    def floats(self) -> Array:
        """[N] bool: views enough look through it, and few of those that tell have a surface there."""
        return (self.free >= FREE_VIEWS) & (self.on < SUPPORT * (self.free + self.on))


def evidence(splats: Splats, cameras: Sequence[Camera], drawn: DrawnAs) -> Evidence:
    """What the views say about the place of each primitive.

    The surface of a pixel is where half of the light is left (the AOV ``median_depth``); a pixel that is never half
    covered has none, and tells nothing. A primitive is looked up at the pixel of its centre. It is on the surface
    where it lies within 15 % of its depth or three of its own standard deviations, free where it is nearer, and
    hidden where it is farther, which tells nothing either.
    """
    picture = picture_of(splats, 0.0, drawn, ("median_depth",))
    free, on = np.zeros(splats.n_splats, int), np.zeros(splats.n_splats, int)
    for camera in cameras:
        surface = picture(camera).aovs["median_depth.Z"]  # [H, W], 0 where there is none
        places = seen_from(splats, camera.position)
        pixels, depths = camera.project(places)
        rows = np.flatnonzero((depths > drawn.near_clip) & ((pixels >= 0) & (pixels < surface.shape[::-1])).all(axis=1))
        column, row = pixels[rows].astype(int).T
        rows, ahead = rows[surface[row, column] > 0], surface[row, column][surface[row, column] > 0]
        rays = places[rows] - camera.position
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        margin = np.maximum(DEPTH_SHARE * ahead, DEVIATIONS * deviations_along(splats, rows, rays))
        free[rows] += depths[rows] < ahead - margin
        on[rows] += abs(depths[rows] - ahead) <= margin
    return Evidence(free, on)
