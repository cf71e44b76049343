"""What cameras see of a model: how far its surface is, and in which colour."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..render.picture import Picture, picture_of
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.splats import Array, Splats

# the AOV, the z of a centre: where the ray is deepest in that primitive was tried, and is worse (docs/mesh.md)
DEPTH = "median_depth"
LEAST_ALPHA = 1e-6  # by which colours are divided


@dataclass(frozen=True)
class SurfaceViews:
    """Pictures of one model, rendered when they are asked for."""

    cameras: list[Camera]
    near: float
    """what is nearer is not drawn, world units along the optical axis"""
    picture: Callable[[Camera], Picture]

    @staticmethod
    def of(splats: Splats, cameras: list[Camera], drawn: DrawnAs) -> SurfaceViews:
        """Of a model that is drawn like that, from these cameras."""
        return SurfaceViews(cameras, drawn.near_clip, picture_of(splats, 0.0, drawn, (DEPTH,)))

    def depth(self, camera: Camera) -> Array:
        """[H, W] depth along the optical axis of what stops half of the light, 0 where nothing does."""
        return self.depth_and_color(camera)[0]

    def depth_and_color(self, camera: Camera) -> tuple[Array, Array]:
        """The same, and [H, W, 3] display-referred colours of the splats alone."""
        seen = self.picture(camera)
        return seen.aovs[f"{DEPTH}.Z"], seen.color / np.maximum(seen.alpha, LEAST_ALPHA)[..., None]


def points_of(camera: Camera, depth: Array) -> Array:
    """[P, 3] where in the world the pixels with a depth see their surface."""
    row, column = np.nonzero(depth)
    z = depth[row, column].astype(np.float64)
    local = np.stack([(column + 0.5 - camera.cx) / camera.fx * z, (row + 0.5 - camera.cy) / camera.fy * z, z], -1)
    return local @ camera.c2w[:3, :3].T + camera.position
