"""Depth maps of the photographs: how far away is what each pixel shows, as a phone with LiDAR or a network says it.

Where the data say which sparse points a view sees (COLMAP), the unit of the world is anything, and networks do not know
the size of what they see. Then the map of each view is scaled, so that the median of its points agrees with it. Other
data are to have poses in the unit of their maps. Their sparse points tell whether that can be, though nobody knows
which views see them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..support.errors import DataError
from .dataset import Dataset, View
from .depth_files import SUFFIXES, read_depth
from .named_like_images import composed, files_like_images, line_on_lacking, require_same_way

LEAST_POINTS = 20  # of a view, by which its map can be scaled
ASKED = 8  # views whose points are asked for the unit
ANOTHER_UNIT = 3.0  # times as far as a map says, or as near, half of the points are not: some are hidden in the view


class Depths:
    """A folder with a depth map per image, of any size, named as the image (``named_like_images.py``).

    Raises ``DataError`` if there is no such folder, or none for any training view, or two for one; and for maps in
    another unit than the poses, where they are not scaled, or of which none can be.
    """

    def __init__(self, folder: str | Path, dataset: Dataset):
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(folder, "no such folder", "give a folder with a depth map per image")
        self.folder, self.paths = folder, depth_files(folder)
        self._dataset = dataset
        self._scales: dict[str, float | None] = {}
        if not any(composed(view.name) in self.paths for view in dataset.train):
            remedy = f"name them like the images, as {dataset.train[0].name}.png"
            raise DataError(folder, "has no depth map for any of the images", remedy)
        if dataset.observations:
            self._require_points()
        else:
            self._require_unit()

    def of(self, view: View) -> np.ndarray | None:
        """The depths of a view of the data, or of a smaller copy of it: float32 [H, W] along the view axis, world
        units; 0 where nothing is known. None for a view without a map, and for one that cannot be scaled.

        A map is one of the photograph: each pixel has the nearest value, as means over an edge are depths of nothing.
        Raises ``DataError``.
        """
        path = self.paths.get(composed(view.name))
        if path is None:
            return None
        depth = read_depth(path)
        if not depth.any():
            raise DataError(path, "knows no depth: all of it is 0, negative or not finite", "remove it, or replace it")
        source = view.straight.source if view.straight else view.camera
        require_same_way(path, (depth.shape[1], depth.shape[0]), (source.width, source.height))
        scale = self._scale(view.name, depth)
        return None if scale is None else depth[_nearest(depth, view)] * np.float32(scale)

    def _require_points(self) -> None:
        """Raise ``DataError`` if no map can be scaled: the training would be one without depths."""
        seen = self._dataset.observations
        mapped = [view.name for view in self._dataset.train if composed(view.name) in self.paths]
        if not any(len(seen[name].points) >= LEAST_POINTS for name in mapped if name in seen):
            problem = f"cannot be scaled: no view with a depth map sees {LEAST_POINTS} sparse points"
            raise DataError(self.folder, problem, "add maps of views that see more, or leave out --depths")

    def _require_unit(self) -> None:
        """Raise ``DataError`` if the maps of some views say that the points in them are somewhere else altogether."""
        mapped = [view for view in self._dataset.train if composed(view.name) in self.paths]
        found = []
        for view in mapped[:: max(1, len(mapped) // ASKED)]:
            pixels, z = view.camera.project(self._dataset.points)
            inside = (z > 0) & ((pixels >= 0) & (pixels < (view.camera.width, view.camera.height))).all(axis=1)
            depth = self.of(view)
            if depth is not None and (factor := _fitted(depth, pixels[inside], z[inside])) is not None:
                found.append(factor)
        if found and not 1 / ANOTHER_UNIT < (factor := float(np.median(found))) < ANOTHER_UNIT:
            problem = f"holds depths in another unit than the poses: points are about {factor:.3g} times as far away"
            raise DataError(self.folder, problem, "multiply the depths, or divide the poses and points, by that")

    def _scale(self, name: str, depth: np.ndarray) -> float | None:
        """Of a map to world units; None where too few points tell."""
        if not self._dataset.observations:
            return 1.0
        if (seen := self._dataset.observations.get(name)) is None:
            return None
        if name not in self._scales:
            view = next(view for view in self._dataset.views if view.name == name)
            _, z = view.camera.project(self._dataset.points[seen.points])
            self._scales[name] = _fitted(depth[_nearest(depth, view)], seen.pixels, z)
        return self._scales[name]


def depth_files(folder: Path) -> dict[str, Path]:
    """The depth maps of a folder, by the ``composed`` names of the views that they are of. Raises ``DataError`` for two
    of one view."""
    return files_like_images(folder, SUFFIXES, "depth map")


def without_depth(folder: str | Path | None, views: Iterable[str]) -> list[str]:
    """A line on those views, by their names, that have no map in the folder; none where all have one, or without a
    folder."""
    if not folder:
        return []
    files, so = depth_files(Path(folder)), "they are learned from their colours alone"
    return line_on_lacking(Path(folder), files, views, "depth map", so)


def _nearest(depth: np.ndarray, view: View) -> tuple[np.ndarray, np.ndarray]:
    """(rows, columns) [H, W] of the pixels of a map [H', W'] that are nearest to those of a view."""
    height, width = depth.shape
    camera = view.camera
    if view.straight:
        source = view.straight.source
        places = replace(view.straight, camera=camera).source_pixels() / (source.width, source.height)  # [H, W, 2]
        x, y = places[..., 0] * width, places[..., 1] * height
    else:
        k = min(width // camera.width, height // camera.height)
        shrunk = k > 1 and (width // k, height // k) == (camera.width, camera.height)  # what is left over is cut off
        per_x, per_y = (k, k) if shrunk else (width / camera.width, height / camera.height)
        x, y = np.meshgrid((np.arange(camera.width) + 0.5) * per_x, (np.arange(camera.height) + 0.5) * per_y)
    return np.clip(y.astype(np.intp), 0, height - 1), np.clip(x.astype(np.intp), 0, width - 1)


def _fitted(depth: np.ndarray, pixels: np.ndarray, z: np.ndarray) -> float | None:
    """What the depths [H, W] of a view are to be multiplied by: the median over points at ``pixels`` [M, 2] with depths
    ``z`` [M]; None for too few of them."""
    height, width = depth.shape
    x, y = np.clip(np.floor(pixels).astype(np.intp), 0, (width - 1, height - 1)).T
    there = depth[y, x]
    known = (there > 0) & (z > 0)
    return float(np.median(z[known] / there[known])) if np.count_nonzero(known) >= LEAST_POINTS else None
