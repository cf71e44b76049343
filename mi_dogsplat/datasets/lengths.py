"""A length that is known between two places of a capture, measured in its units.

A place is where an image was taken, told by its name, or a point of the scene, marked in an image as ``NAME:X,Y`` in
pixels of the image at its full size: x to the right, y down, from the top left corner. One mark takes its depth from
the points of structure from motion around it. Marks of one point in several images, joined by ``+``, are triangulated.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..support.errors import DataError
from .dataset import Dataset, View, view_meant, view_name

MARK = r"(.+?):(-?\d+(?:\.\d+)?),(-?\d+(?:\.\d+)?)(?:\+(?=.)|$)"  # up to the next one: names may have a + too
NEAR = 1.5  # degrees from a mark: there lie the points that tell its depth
NEAREST = 5  # of these points
SPREAD = 0.1  # of their depth, at most, or they lie on several things
LEAST_PARALLAX = 1.0  # degrees between the rays of marks
MISS = 0.02  # of their depth: how far the rays of one point may pass from it
AGAIN = "mark it in a second image too: A:X,Y+B:X,Y"
FLAG, POSED = "--scale", "has a pose"


@dataclass(frozen=True, eq=False)
class Standpoint:
    """Where an image was taken, and what is known to be seen in it.

    ``position`` [3]; ``ray`` takes a pixel [2] of the image at its full size to a unit vector [3] of the world;
    ``points`` [M, 3] are those of structure from motion that it sees.
    """

    position: np.ndarray
    ray: Callable[[np.ndarray], np.ndarray]
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))


def length_in_units(ends: tuple[str, str], standpoints: Mapping[str, Standpoint]) -> float:
    """The distance between two places that are told as above. Raises ``DataError``.

    Images have the names of the standpoints, or those of the views (``view_name``); white space may stand for ``_``.
    """
    named = {view_name(name): at for name, at in standpoints.items()} | dict(standpoints)
    first, second = (_place(end, named) for end in ends)
    length = float(np.linalg.norm(first - second))
    if not length > 0:
        raise DataError(FLAG, f'"{ends[0]}" and "{ends[1]}" are the same place', "name two different places")
    return length


def require_images(ends: tuple[str, str], images: Collection[str]) -> None:
    """Raise ``DataError`` for a place that is told by none of the ``images``, named as above: said before poses are
    looked for."""
    names = {*images, *map(view_name, images)}
    for told in ends:
        for name in [told] if told in names else [mark[1] for mark in _marks(told)] or [told]:
            if view_meant(name, names) is None:
                raise _no_image(name, "is there", images)


def standpoints_of(dataset: Dataset, factor: int = 1) -> dict[str, Standpoint]:
    """Those of the views of a data set whose images are smaller by this factor than at their full size."""
    return {view.name: _of_view(view, dataset, factor) for view in dataset.views}


def _of_view(view: View, dataset: Dataset, factor: int) -> Standpoint:
    camera, seen = view.camera, dataset.observations.get(view.name)

    def ray(pixel: np.ndarray) -> np.ndarray:
        pixel = pixel / factor
        x, y = (view.straight.points(pixel[None])[0] if view.straight else pixel) - (camera.cx, camera.cy)
        return camera.c2w[:3, :3] @ _unit(np.array([x / camera.fx, y / camera.fy, 1.0]))

    rows = np.zeros(0, int) if seen is None else seen.points
    return Standpoint(camera.position, ray, dataset.points[rows].astype(np.float64))


def _place(told: str, standpoints: Mapping[str, Standpoint]) -> np.ndarray:
    """The place [3] that a word tells."""
    if told in standpoints:
        return standpoints[told].position
    marks = _marks(told)
    if not marks:
        if at := _named(told, standpoints):
            return at.position
        raise _no_image(told, POSED, standpoints)
    rays: list[tuple[Standpoint, np.ndarray]] = []
    for mark in marks:
        if not (at := _named(mark[1], standpoints)):
            raise _no_image(mark[1], POSED, standpoints)
        rays.append((at, at.ray(np.array([float(mark[2]), float(mark[3])]))))
    if not all(np.isfinite(ray).all() for _, ray in rays):
        raise DataError(FLAG, f'"{told}" is outside of the image', "give pixels of the image at its full size")
    if len(rays) > 1:
        return _triangulated(told, rays)
    return _by_depth(told, *rays[0])


def _marks(told: str) -> list[re.Match[str]]:
    """The marks of which a word consists; none of a word that is a name."""
    marks = list(re.finditer(MARK, told))
    return marks if marks and marks[-1].end() == len(told) else []


def _named(name: str, standpoints: Mapping[str, Standpoint]) -> Standpoint | None:
    meant = view_meant(name, standpoints)
    return standpoints[meant] if meant is not None else None


def _no_image(name: str, lacks: str, images: Iterable[str]) -> DataError:
    like = min(images)
    remedy = f"name two of them, like {like}, or points in them, like {like}:120,80"
    return DataError(FLAG, f'no image "{name}" {lacks}', remedy)


def _triangulated(told: str, rays: list[tuple[Standpoint, np.ndarray]]) -> np.ndarray:
    """The point [3] nearest to all rays by least squares."""
    cosine = min(float(a @ b) for i, (_, a) in enumerate(rays) for _, b in rays[:i])
    if np.degrees(np.arccos(np.clip(cosine, -1, 1))) < LEAST_PARALLAX:
        raise DataError(FLAG, f'the images of "{told}" see it from one direction', "mark it in images further apart")
    across = [np.eye(3) - np.outer(ray, ray) for _, ray in rays]  # [3, 3] each: what is not along the ray
    ahead = sum((a @ at.position for a, (at, _) in zip(across, rays, strict=True)), np.zeros(3))
    point = np.linalg.solve(np.sum(across, axis=0), ahead)
    for a, (at, ray) in zip(across, rays, strict=True):
        offset = point - at.position
        if offset @ ray <= 0 or np.linalg.norm(a @ offset) > MISS * (offset @ ray):
            raise DataError(FLAG, f'the marks of "{told}" do not belong to one point', "check their pixels")
    return point


def _by_depth(told: str, at: Standpoint, ray: np.ndarray) -> np.ndarray:
    """The point [3] along a ray at the depth of the points of structure from motion next to it."""
    offsets = at.points - at.position
    distances = np.linalg.norm(offsets, axis=1)
    angle = np.degrees(np.arccos(np.clip(offsets @ ray / np.maximum(distances, 1e-30), -1, 1)))
    beside = np.argsort(angle)[:NEAREST]
    beside = beside[angle[beside] < NEAR]
    if not len(beside):
        raise DataError(FLAG, f'no point of structure from motion lies near "{told}"', AGAIN)
    depths = distances[beside]
    if np.ptp(depths) > SPREAD * np.median(depths):
        span = f"{depths.min():.3g} to {depths.max():.3g}"
        raise DataError(FLAG, f'the points near "{told}" lie {span} units away, so on several objects', AGAIN)
    return at.position + ray * float(np.median(depths))


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)
