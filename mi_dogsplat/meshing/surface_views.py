"""What cameras see of a model: how far its surface is, and in which colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..engine.device_camera import DeviceCamera
from ..engine.median_surface import median_surface
from ..engine.options import RasterOptions
from ..engine.parameters import upload
from ..engine.rasterize import Frame, rasterize
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.splats import Array, Splats
from ..support.srgb import displayed

LEAST_ALPHA = 1e-6  # by which colours are divided


@dataclass(frozen=True)
class SurfaceViews:
    """Pictures of one model, rendered when they are asked for."""

    cameras: list[Camera]
    drawn: DrawnAs
    params: dict
    """of the model, as ``upload`` makes them"""
    options: RasterOptions

    @staticmethod
    def of(splats: Splats, cameras: list[Camera], drawn: DrawnAs) -> SurfaceViews:
        """Of a model that is drawn like that, from these cameras."""
        options = RasterOptions(sh_degree=splats.sh_degree, antialiased=drawn.antialiased)
        return SurfaceViews(cameras, drawn, upload(splats), options)

    @property
    def near(self) -> float:
        """What is nearer is not drawn, world units along the optical axis."""
        return self.drawn.near_clip

    def depth(self, camera: Camera) -> Array:
        """[H, W] depth along the optical axis of the surface that stops half of the light, 0 where none does."""
        return self._seen(camera)[1]

    def depth_and_color(self, camera: Camera) -> tuple[Array, Array]:
        """The same, and [H, W, 3] display-referred colours of the splats alone."""
        frame, depth = self._seen(camera)
        planes = np.stack([plane.numpy().reshape(depth.shape) for plane in frame.colors], axis=-1)
        alpha = 1 - frame.T.numpy().reshape(*depth.shape, 1)
        color = planes / np.maximum(alpha, LEAST_ALPHA)
        return depth, displayed(color, self.drawn.white) if self.drawn.linear else np.clip(color, 0, 1)

    def _seen(self, camera: Camera) -> tuple[Frame, Array]:
        on_device = DeviceCamera.upload(camera, self.near)
        frame = rasterize(self.params, on_device, self.options)
        depth = median_surface(self.params, on_device, frame).numpy()
        return frame, depth.reshape(camera.height, camera.width)


def points_of(camera: Camera, depth: Array) -> Array:
    """[P, 3] where in the world the pixels with a depth see their surface."""
    row, column = np.nonzero(depth)
    z = depth[row, column].astype(np.float64)
    local = np.stack([(column + 0.5 - camera.cx) / camera.fx * z, (row + 0.5 - camera.cy) / camera.fy * z, z], -1)
    return local @ camera.c2w[:3, :3].T + camera.position
