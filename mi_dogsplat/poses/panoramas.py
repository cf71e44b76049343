"""Panoramas of all directions (360°): each becomes the six views of a cube, whose pinholes every program knows.

A panorama is equirectangular: twice as wide as high, longitude across, latitude down, its middle straight ahead. The
views look ahead, right, back, left, down and up from one place, each 90° wide. A pixel in the middle of a view is as
wide as one of the panorama on its equator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from ..datasets.images import read_image
from ..support.cores import usable_cores
from ..support.errors import DataError
from .config import EQUIRECTANGULAR
from .photographs import Photograph
from .resampled import write_resampled

SIDES = {  # where each view looks (x right, y down, z ahead): its right and its down; what is ahead of it follows
    "front": ((1, 0, 0), (0, 1, 0)),
    "right": ((0, 0, -1), (0, 1, 0)),
    "back": ((-1, 0, 0), (0, 1, 0)),
    "left": ((0, 0, 1), (0, 1, 0)),
    "down": ((1, 0, 0), (0, 0, -1)),
    "up": ((1, 0, 0), (0, 0, 1)),
}
MOST_THREADS = 4  # a panorama of 5760x2880 takes nearly 1 GB while it is cut
SEAM = 8  # pixels beyond each edge that a spline sees: a panorama goes on round the circle, and beyond its poles


def side_rotation(side: str) -> np.ndarray:
    """The rotation [3, 3] from the axes of the panorama to those of a view."""
    right, down = map(np.array, SIDES[side])
    return np.stack([right, down, np.cross(right, down)]).astype(np.float64)


def side_size(width: int) -> int:
    """Pixels along a view of a panorama of this width."""
    return round(width / math.pi)


@dataclass(frozen=True)
class Cut:
    """Views of panoramas of one size, [H, W] pixels with H = W / 2."""

    width: int

    def pixels(self, side: str) -> np.ndarray:
        """Rows and columns [2, S, S] in the panorama, 0 in the middle of the first, that the pixels of a view show."""
        size = side_size(self.width)
        x = (np.arange(size) + 0.5) / size * 2 - 1
        rays = np.stack([*np.meshgrid(x, x), np.ones((size, size))], axis=-1) @ side_rotation(side)  # [S, S, 3]
        longitude = np.arctan2(rays[..., 0], rays[..., 2])
        latitude = np.arctan2(rays[..., 1], np.hypot(rays[..., 0], rays[..., 2]))
        pixel = self.width / (2 * math.pi)
        return np.stack([latitude + math.pi / 2, longitude + math.pi]) * pixel - 0.5

    @cached_property
    def _places(self) -> dict[str, np.ndarray]:
        """Rows and columns by the views, in the panorama with its ``SEAM``."""
        return {side: (self.pixels(side) + SEAM).astype(np.float32) for side in SIDES}

    def views(self, panorama: np.ndarray) -> dict[str, np.ndarray]:
        """The views [S, S, C] of a panorama [H, W, C] by cubic splines, float32, between its least and largest
        values."""
        size, channels = side_size(self.width), panorama.shape[2]
        made = {side: np.empty((size, size, channels), np.float32) for side in SIDES}
        for c, plane in enumerate(np.moveaxis(panorama, -1, 0)):
            opposite = np.roll(plane, self.width // 2, axis=1)  # what lies beyond a pole
            whole = np.concatenate([opposite[SEAM - 1 :: -1], plane, opposite[: -SEAM - 1 : -1]])
            whole = np.pad(whole, ((0, 0), (SEAM, SEAM)), mode="wrap")
            spline = spline_filter(whole, mode="mirror").astype(np.float32)
            for side, places in self._places.items():
                seen = map_coordinates(spline, places, np.float32, prefilter=False)
                made[side][..., c] = np.clip(seen, plane.min(), plane.max())
        return made


def cut_of(sizes: Mapping[Path, tuple[int, int]]) -> Cut:
    """How panoramas of these widths and heights are cut. Raises ``DataError`` where one is none, or they differ."""
    first, (wide, _) = next(iter(sizes.items()))
    for path, (width, height) in sizes.items():
        if width != 2 * height:
            problem = f"is {width}x{height}, but a panorama of all directions is twice as wide as high"
            raise DataError(path, problem, f"leave it out, or leave out --lens {EQUIRECTANGULAR}")
        if width != wide:
            problem = f"is {width}x{height}, and {first.name} is {wide}x{wide // 2}"
            raise DataError(path, problem, "export all panoramas in one size")
    return Cut(wide)


def cut_panoramas(
    photographs: Sequence[Photograph], panoramas: Path, images: Path, progress: Callable[[int, int], None]
) -> list[Photograph]:
    """Write the views of all panoramas of a folder as ``<side>/<name>`` into ``images``, unless they are there.

    Raises ``DataError``.
    """
    cut, made = cut_of({panoramas / p.name: (p.width, p.height) for p in photographs}), []
    with ThreadPoolExecutor(min(MOST_THREADS, usable_cores())) as pool:  # SciPy and Pillow let go of the lock
        for views in pool.map(lambda photograph: _views(photograph, cut, panoramas, images), photographs):
            made += views
            progress(len(made) // len(SIDES), len(photographs))
    return made


def cut_masks(photographs: Sequence[Photograph], panoramas: Path, masks: Path) -> int:
    """Write the views of the masks ``<name>.png`` of panoramas into ``masks``; returns how many."""
    cut, n = Cut(photographs[0].width), 0
    for photograph in photographs:
        mask = panoramas / f"{photograph.name}.png"
        if not mask.is_file():
            continue
        targets = {side: masks / side / mask.name for side in SIDES}
        n += len(targets)
        if all(target.is_file() for target in targets.values()):
            continue
        for side, view in cut.views(read_image(mask)[..., :1]).items():
            write_resampled(np.repeat(view >= 0.5, 3, axis=2), targets[side])
    return n


def panorama_of(name: str) -> str:
    """The name of the panorama that a view of this name is of."""
    return name.partition("/")[2]


def _views(photograph: Photograph, cut: Cut, panoramas: Path, images: Path) -> list[Photograph]:
    """The views of one panorama, which is read where one of them is missing."""
    targets = {side: images / side / photograph.name for side in SIDES}
    if not all(target.is_file() for target in targets.values()):
        for side, view in cut.views(read_image(panoramas / photograph.name)).items():
            write_resampled(view, targets[side])
    size = side_size(cut.width)
    return [
        Photograph(
            f"{side}/{photograph.name}", size, size, f"{side} {size}", size / 2,
            down=tuple(side_rotation(side) @ (0.0, 1.0, 0.0)),
        )  # fmt: skip
        for side in SIDES
    ]
