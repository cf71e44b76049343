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

# an AOV, of the z of centres: where the ray is deepest in that primitive was tried, and is worse (docs/mesh.md)
DEPTH = "median_depth"
LEAST_ALPHA = 0.5  # where there is a surface, by which colours are divided; half of the light is stopped
KEPT_SHARE = 0.25  # of the free memory, for pictures that need not be rendered again


class Seen(NamedTuple):
    """The surface in a view."""

    camera: Camera
    depth: Array
    """[H, W] along the optical axis, of what stops half of the light, or the mean; 0 where nothing stops so much"""
    color: Array
    """[H, W, 3] display-referred, half floats: of the splats alone, meaningless where there is no surface; or of the
    photograph, NaN where it says nothing of the surface"""


@dataclass(frozen=True)
class SurfaceViews:
    """Pictures of one model: each walk over the views renders those that there was no room to keep."""

    cameras: list[Camera]
    near: float
    """what is nearer is not drawn, world units along the optical axis"""
    picture: Callable[[Camera], Picture]
    room: int
    """bytes of pictures to keep"""
    photographs: Callable[[int, Array], Array] | None = None
    """the colours of a view by its number and the model's colours in it, in place of these"""
    depth: str = DEPTH
    """the AOV that is the depth"""
    _kept: dict[int, Seen] = field(default_factory=dict)

    @staticmethod
    def of(
        splats: Splats,
        cameras: list[Camera],
        drawn: DrawnAs,
        photographs: Callable[[int, Array], Array] | None = None,
        depth: str = DEPTH,
    ) -> SurfaceViews:
        """Of a model that is drawn like that, from these cameras; ``depth``: the AOV."""
        room = int(KEPT_SHARE * (available_memory() or 0))
        picture = picture_of(splats, 0.0, drawn, (depth,))
        return SurfaceViews(cameras, drawn.near_clip, picture, room, photographs, depth)

    def __iter__(self) -> Iterator[Seen]:
        """The views, in the order of the cameras."""
        taken = sum(map(_size, self._kept.values()))
        for k in range(len(self.cameras)):
            if (seen := self._kept.get(k)) is None:
                seen = self._seen(k)
                if taken + _size(seen) <= self.room:
                    self._kept[k] = seen
                    taken += _size(seen)
            yield seen

    def _seen(self, k: int) -> Seen:
        picture = self.picture(self.cameras[k])
        own = _own_color(picture)
        color = own if self.photographs is None else self.photographs(k, own)
        depth = picture.aovs[f"{self.depth}.Z"]
        if self.depth != DEPTH:  # which is 0 by itself where nothing stops half of the light
            depth = np.where(picture.alpha >= LEAST_ALPHA, depth, np.float32(0))
        return Seen(self.cameras[k], depth, color.astype(np.float16))


def _own_color(picture: Picture) -> Array:
    """[H, W, 3] of the splats alone."""
    alpha = np.maximum(picture.alpha, LEAST_ALPHA)[..., None]
    if picture.radiance is None:
        return np.minimum(picture.color / alpha, 1)
    return displayed(picture.radiance / alpha, picture.white)  # what is blended, and not what a screen shows of it


def _size(seen: Seen) -> int:
    """Bytes of its pictures."""
    return seen.depth.nbytes + seen.color.nbytes


def points_of(camera: Camera, depth: Array) -> Array:
    """[P, 3] where in the world the pixels with a depth see their surface."""
    row, column = np.nonzero(depth)
    return camera.unproject(np.stack([column, row], axis=-1) + 0.5, depth[row, column])
