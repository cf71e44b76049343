"""Splats alone, as a request without a scene sees them: any rows of the picture, with its passes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..engine.aovs import options_for
from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..plugin.camera_masks import SplatMasks
from ..render.picture import Picture, render_picture
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.sh_basis import sh_degree_of
from .data_passes import emptied
from .masks import require_counts, splat_masks, without_holdouts
from .mattes import ranked
from .objects import object_of_primitive
from .request import Request
from .scene_description import drawn_of, number_of

AOV_OF_PASS = {"depth": "depth", "normal": "normal", "object": "index", "matte": "index"}


@dataclass(frozen=True)
class SplatsAlone:
    """A model as the camera of a request sees it."""

    request: Request
    camera: Camera
    params: dict
    drawn: DrawnAs
    options: RasterOptions
    masks: SplatMasks | None

    @staticmethod
    def of(request: Request, shape: Any, camera: Camera) -> SplatsAlone:
        """Of a shape ``dog``. Raises ``DataError`` where the objects of the request are not made of its primitives."""
        n = number_of(shape)
        require_counts(request, n)
        drawn = drawn_of(request, shape)
        options = RasterOptions(sh_degree=sh_degree_of(shape.sh_size), antialiased=drawn.antialiased)
        params, masks = shape.parameters, splat_masks(request, n)
        if masks:
            params = masks.shown(params, drawn.linear)
        return SplatsAlone(request, camera, params, drawn, options, masks)

    def rows(self, top: int, bottom: int) -> dict[str, np.ndarray]:
        """What ``Answerer.answer`` says of splats alone, of the rows from ``top`` to before ``bottom``."""
        camera, request = self.camera, self.request
        part = Camera(camera.w2c, camera.fx, camera.fy, camera.cx, camera.cy - top, camera.width, bottom - top)
        left, above, right, below = request.film or (0.0, 0.0, float(camera.width), float(camera.height))
        film = (left, above - top, right, below - top)
        how = {"film": film, "perspective": not request.orthographic}
        names = sorted({AOV_OF_PASS[name] for name in request.passes})
        options = options_for(names, self.options)
        picture = render_picture(self.params, part, options, 0.0, self.drawn, names, **how)
        color = picture.color if picture.radiance is None else np.maximum(picture.radiance, 0)
        hole = np.zeros_like(picture.alpha)
        if self.masks:
            seen = DeviceCamera.upload(part, self.drawn.near_clip, **how)
            hole = self.masks.hole(self.params, seen, self.options, None).numpy().reshape(hole.shape)
        alpha = picture.alpha - hole
        found = {"color": color, "alpha": alpha, **_planes(picture, alpha, request)}
        if picture.depth is not None:
            found["depth"] = np.where(picture.alpha > 0, picture.depth, np.inf)
        if request.holdout:  # be it of objects that have no primitives
            found = emptied(found, hole) | {"hole": hole}
        return found


def _planes(picture: Picture, alpha: np.ndarray, request: Request) -> dict[str, np.ndarray]:
    """AOVs of splats as passes; an object covers what all splats of a pixel cover where it is the first of them."""
    found = {}
    if "normal" in request.passes:
        found["normal"] = np.stack([picture.aovs[f"normal.{axis}"] for axis in "XYZ"], -1)
    if "index" in (AOV_OF_PASS[name] for name in request.passes):
        number = object_of_primitive(picture.aovs["index.I"].astype(np.int64), request.counts)
        number = without_holdouts(number, request)
        found["object"], found["matte"] = number, ranked([(number, alpha.clip(0, 1))])
    return {name: array for name, array in found.items() if name in request.passes}
