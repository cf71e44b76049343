"""The window matrix of a region in pixels."""

from __future__ import annotations

from typing import Any, NamedTuple


class Projection(NamedTuple):
    """Of points in the space of the view, where x is to the right and y up: their pixels, from the upper left corner.

    focal: pixels, of parallel rays pixels per unit. center: where the axis of the view is.
    """

    focal: tuple[float, float]
    center: tuple[float, float]


def projection_of(space: Any, width: int, height: int) -> Projection:
    """Of a region of so many pixels: ``space`` is its ``RegionView3D``."""
    matrix, half = space.window_matrix, (width / 2, height / 2)
    shift = (-matrix[0][2], -matrix[1][2]) if space.is_perspective else (matrix[0][3], matrix[1][3])
    center = half[0] * (1 + shift[0]), half[1] * (1 - shift[1])
    return Projection((half[0] * matrix[0][0], half[1] * matrix[1][1]), center)
