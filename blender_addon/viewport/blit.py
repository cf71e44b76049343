"""A picture of the package in a region of Blender's window, without any shading by Blender."""

from __future__ import annotations

import gpu
import numpy as np
from gpu_extras.presets import draw_texture_2d

from ..objects.working_space import to_working, working_space

FORMAT = "RGBA16F"


class Blit:
    """Keeps the texture of the latest picture."""

    def __init__(self):
        self._pixels: np.ndarray | None = None
        self._space: str | None = None
        self._texture: gpu.types.GPUTexture | None = None

    def draw(
        self, pixels: np.ndarray, left: float, bottom: float, width: float, height: float, linear: bool = False
    ) -> None:
        """Draw [H, W, 4], premultiplied and from the top, over a rectangle of the region, in its pixels.

        ``linear``: the colours are linear ones of Rec. 709, and not the values of a file.
        """
        space = working_space() if linear else None
        if pixels is not self._pixels or space != self._space:
            rows, columns = pixels.shape[:2]
            colors = to_working(pixels[..., :3]) if linear else pixels[..., :3]
            shown = np.concatenate([colors, pixels[..., 3:]], axis=2, dtype=np.float32)
            values = gpu.types.Buffer("FLOAT", (pixels.size,), shown.ravel())
            self._texture = gpu.types.GPUTexture((columns, rows), format=FORMAT, data=values)
            self._pixels, self._space = pixels, space
        gpu.state.blend_set("ALPHA_PREMULT")
        draw_texture_2d(self._texture, (left, bottom + height), width, -height)
        gpu.state.blend_set("NONE")
