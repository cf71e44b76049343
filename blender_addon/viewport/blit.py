"""A picture of the package in a region of Blender's window, without any shading by Blender."""

from __future__ import annotations

import gpu
import numpy as np
from gpu_extras.presets import draw_texture_2d

FORMAT = "RGBA16F"


class Blit:
    """Keeps the texture of the latest picture."""

    def __init__(self):
        self._pixels: np.ndarray | None = None
        self._texture: gpu.types.GPUTexture | None = None

    def draw(self, pixels: np.ndarray, left: float, bottom: float, width: float, height: float) -> None:
        """Draw [H, W, 4], premultiplied and from the top, over a rectangle of the region, in its pixels."""
        if pixels is not self._pixels:
            rows, columns = pixels.shape[:2]
            values = gpu.types.Buffer("FLOAT", (pixels.size,), np.ascontiguousarray(pixels, np.float32).ravel())
            self._texture, self._pixels = gpu.types.GPUTexture((columns, rows), format=FORMAT, data=values), pixels
        gpu.state.blend_set("ALPHA_PREMULT")
        draw_texture_2d(self._texture, (left, bottom + height), width, -height)
        gpu.state.blend_set("NONE")
