"""Depth maps of the photographs: how far away is what each pixel shows, as a phone with LiDAR or a network says it.

Where the data say which sparse points a view sees (COLMAP), the unit of the world is anything, and networks do not know
the size of what they see. Then the points tell whether the maps hold depth or inverse depth, and the map of each view
is fitted to its points (``depth_fits.py``). Other data are to have maps of depth, and poses in their unit. Their sparse
points tell whether that can be, though nobody knows which views see them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.cameras import Camera
from ..support.errors import DataError
from ..support.wording import counted
from .dataset import Dataset, View
from .depth_files import SUFFIXES, read_depth
from .depth_fits import UNCLEAR, Fit, Samples, depth_correlation, fitted
from .named_like_images import composed, files_like_images, line_on_lacking, require_same_way

LEAST_POINTS = 20  # of a view, by which its map can be scaled
WORST_FIT = 0.2  # median relative error at the points: the map of a view says something else
ASKED = 8  # views whose points are asked for the unit
CELLS = 24  # along each side of a view, in which the nearest point may be seen
AS_IT_IS = Fit(1.0, 0.0, inverse=False)
NEARER, FARTHER = 0.8, 3.0
"""Times as far as a map says half of the points in a view are, if the unit is the same. Some are hidden there, which
makes that more. What could make it less is a map that is too far as a whole."""


class Depths:
    """A folder with a depth map per image, of any size, named as the image (``named_like_images.py``).

    Raises ``DataError`` if there is no such folder, or none for any training view, or two for one; and for maps in
    another unit than the poses, where they are not scaled, or of which none can be, or which nobody can tell for depth
    or inverse depth. Where they are scaled, it reads each map.
    """

    def __init__(self, folder: str | Path, dataset: Dataset):
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(folder, "no such folder", "give a folder with a depth map per image")
        self.folder, self.paths = folder, depth_files(folder)
        self._dataset = dataset
        self._fits: dict[str, Fit] = {}  # of views whose maps are used, where they are scaled
        self._too_few, self._contradicted = [], []  # names of views whose maps are not
        if not any(composed(view.name) in self.paths for view in dataset.train):
            remedy = f"name them like the images, as {dataset.train[0].name}.png"
            raise DataError(folder, "has no depth map for any of the images", remedy)
        if dataset.observations:
            self._fit()
        else:
            self._require_unit()

    def of(self, view: View) -> np.ndarray | None:
        """The depths of a training view of the data, or of a smaller copy of it: float32 [H, W] along the view axis,
        world units; 0 where nothing is known. None for a view without a map, and for one that cannot be scaled.

        A map is one of the photograph: each pixel has the nearest value, as means over an edge are depths of nothing.
        Raises ``DataError``.
        """
        path = self.paths.get(composed(view.name))
        if path is None or (self._dataset.observations and view.name not in self._fits):
            return None
        fit = self._fits.get(view.name, AS_IT_IS)
        values = self._values(path, view, coarse=fit.inverse)
        return fit.depth(values[_nearest(values, view)])

    def notes(self) -> list[str]:
        """A line on what the maps hold, and one on those that are not used; none where nothing is scaled."""
        if not self._fits:
            return []
        used, known = len(self._fits), self.summary()
        kind = "inverse depth" if known["inverse"] else "depth"
        so = f"the median error at these is {100 * known['error']:.1f} %"
        lines = [f"{self.folder}: the maps hold {kind}, by the sparse points of {counted(used, 'view')}; {so}"]
        if left := self._too_few + self._contradicted:
            few = f"{len(self._too_few)} with fewer than {LEAST_POINTS} sparse points"
            bad = f"{len(self._contradicted)} off by more than {100 * WORST_FIT:.0f} % at half of them"
            said = f"{self.folder}: {len(left)} of {len(left) + used} depth maps are not used, such as that of"
            lines.append(f"{said} {min(left)} ({few}, {bad}); these views are learned from their colours alone")
        return lines

    def summary(self) -> dict[str, Any]:
        """Of how many training ``views`` maps are ``used``, whether these hold ``inverse`` depth, and their median
        relative ``error`` at the sparse points; that is None where nothing is scaled."""
        fits = list(self._fits.values())
        error = float(np.median([fit.error for fit in fits])) if fits else None
        used, inverse = len(fits or self._mapped()), any(fit.inverse for fit in fits)
        return {"views": len(self._dataset.train), "used": used, "inverse": inverse, "error": error}

    def _mapped(self) -> list[View]:
        """The training views that have maps."""
        return [view for view in self._dataset.train if composed(view.name) in self.paths]

    def _values(self, path: Path, view: View, coarse: bool) -> np.ndarray:
        """The map [H', W'] of a view, ``coarse`` if it may be of 8 bits. Raises ``DataError``."""
        values = read_depth(path, coarse)
        if not values.any():
            raise DataError(path, "knows no depth: all of it is 0, negative or not finite", "remove it, or replace it")
        source = view.straight.source if view.straight else view.camera
        require_same_way(path, (values.shape[1], values.shape[0]), (source.width, source.height))
        return values

    def _fit(self) -> None:
        """Fit each map to the points that its view sees. Raises ``DataError`` if no map can be: the training would be
        one without depths."""
        samples: dict[str, Samples] = {}
        for view in self._mapped():
            found = self._seen(view)
            if found is None or len(found.z) < LEAST_POINTS:
                self._too_few.append(view.name)
            else:
                samples[view.name] = found
        if not samples:
            problem = f"cannot be scaled: no view with a depth map sees {LEAST_POINTS} sparse points"
            raise DataError(self.folder, problem, "add maps of views that see more, or leave out --depths")
        remedy = "check that these are the depth maps of these images, or leave out --depths"
        correlation = depth_correlation(samples.values())
        if abs(correlation) < UNCLEAR:
            found = f"have a rank correlation of {correlation:.2f} with the depths of the sparse points"
            raise DataError(self.folder, f"holds neither depth nor inverse depth: its values {found}", remedy)
        fits = {name: fitted(those, inverse=correlation < 0) for name, those in samples.items()}
        self._fits = {name: fit for name, fit in fits.items() if fit.error <= WORST_FIT}
        self._contradicted = [name for name in fits if name not in self._fits]
        if not self._fits:
            problem = f"cannot be scaled: each map is off by more than {100 * WORST_FIT:.0f} % at half of its points"
            raise DataError(self.folder, problem, remedy)

    def _seen(self, view: View) -> Samples | None:
        """The map of a view at the points that it sees; None where the data do not say which."""
        seen = self._dataset.observations.get(view.name)
        if seen is None or len(seen.points) < LEAST_POINTS:
            return None
        values = self._values(self.paths[composed(view.name)], view, coarse=True)
        _, z = view.camera.project(self._dataset.points[seen.points])
        return _samples(values[_nearest(values, view)], seen.pixels, z)

    def _require_unit(self) -> None:
        """Raise ``DataError`` if the maps of some views say that the points in them are somewhere else altogether, or
        that the farther of them are nearer."""
        mapped = self._mapped()
        found: list[Samples] = []
        for view in mapped[:: max(1, len(mapped) // ASKED)]:
            pixels, z = view.camera.project(self._dataset.points)
            front = _frontmost(pixels, z, view.camera)
            depth = self.of(view)
            samples = None if depth is None else _samples(depth, pixels[front], z[front])
            if samples is not None and len(samples.z) >= LEAST_POINTS:
                found.append(samples)
        if not found:
            return
        if (correlation := depth_correlation(found)) < -UNCLEAR:
            said = f"its values have a rank correlation of {correlation:.2f} with the depths of the points"
            remedy = "convert it to depth, or give a COLMAP model that says which points each view sees"
            raise DataError(self.folder, f"seems to hold inverse depth: {said}", remedy)
        factor = float(np.median([fitted(samples, inverse=False).scale for samples in found]))
        if not NEARER <= factor <= FARTHER:
            problem = f"holds depths in another unit than the poses: points are about {factor:.3g} times as far away"
            raise DataError(self.folder, problem, "multiply the depths, or divide the poses and points, by that")


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


def _frontmost(pixels: np.ndarray, z: np.ndarray, camera: Camera) -> np.ndarray:
    """Rows of those points at ``pixels`` [M, 2] with depths ``z`` [M] that are the nearest of all in a cell of the
    image: many others are hidden, as most of a flat is in a view of one room."""
    size = (camera.width, camera.height)
    inside = np.flatnonzero((z > 0) & ((pixels >= 0) & (pixels < size)).all(axis=1))
    column, row = (pixels[inside] / size * CELLS).astype(np.intp).T
    cell = row * CELLS + column
    order = np.lexsort((z[inside], cell))
    return inside[order[np.unique(cell[order], return_index=True)[1]]]


def _samples(values: np.ndarray, pixels: np.ndarray, z: np.ndarray) -> Samples:
    """What a map in the size of its view [H, W] knows at points at ``pixels`` [M, 2] with depths ``z`` [M]."""
    height, width = values.shape
    x, y = np.clip(np.floor(pixels).astype(np.intp), 0, (width - 1, height - 1)).T
    there = values[y, x].astype(np.float64)
    known = (there > 0) & (z > 0)
    return Samples(there[known], z[known].astype(np.float64))
