"""What cameras see of a model: how far its surface is, and in which colour."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..render.picture import Picture, picture_of
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.splats import Array, Splats
from ..support.memory import available_memory
from ..support.srgb import displayed

# the AOV, the z of a centre: where the ray is deepest in that primitive was tried, and is worse (docs/mesh.md)
DEPTH = "median_depth"
LEAST_ALPHA = 0.5  # where there is a surface, by which colours are divided
KEPT_SHARE = 0.25  # of the free memory, for pictures that need not be rendered again


class Seen(NamedTuple):
    """The surface in a view."""

    camera: Camera
    depth: Array
    """[H, W] along the optical axis, of what stops half of the light; 0 where nothing does"""
    color: Array
    """[H, W, 3] display-referred, of the splats alone, half floats; meaningless where there is no surface"""


@dataclass(frozen=True)
class SurfaceViews:
    """Pictures of one model: each walk over the views renders those that there was no room to keep."""

    cameras: list[Camera]
    near: float
    """what is nearer is not drawn, world units along the optical axis"""
    picture: Callable[[Camera], Picture]
    room: int
    """bytes of pictures to keep"""
    _kept: dict[int, Seen] = field(default_factory=dict)

    @staticmethod
    def of(splats: Splats, cameras: list[Camera], drawn: DrawnAs) -> SurfaceViews:
        """Of a model that is drawn like that, from these cameras."""
        room = int(KEPT_SHARE * (available_memory() or 0))
        return SurfaceViews(cameras, drawn.near_clip, picture_of(splats, 0.0, drawn, (DEPTH,)), room)

    def __iter__(self) -> Iterator[Seen]:
        """The views, in the order of the cameras."""
        taken = sum(map(_size, self._kept.values()))
        for k, camera in enumerate(self.cameras):
            if (seen := self._kept.get(k)) is None:
                seen = self._rendered(camera)
                if taken + _size(seen) <= self.room:
                    self._kept[k] = seen
                    taken += _size(seen)
            yield seen

    def _rendered(self, camera: Camera) -> Seen:
        picture = self.picture(camera)
        alpha = np.maximum(picture.alpha, LEAST_ALPHA)[..., None]
        if picture.radiance is None:
            color = np.minimum(picture.color / alpha, 1)
        else:  # which is what is blended, and not what a screen shows of it
            color = displayed(picture.radiance / alpha, picture.white)
        return Seen(camera, picture.aovs[f"{DEPTH}.Z"], color.astype(np.float16))


def _size(seen: Seen) -> int:
    """Bytes of its pictures."""
    return seen.depth.nbytes + seen.color.nbytes


def points_of(camera: Camera, depth: Array) -> Array:
    """[P, 3] where in the world the pixels with a depth see their surface."""
    row, column = np.nonzero(depth)
    return camera.unproject(np.stack([column, row], axis=-1) + 0.5, depth[row, column])
