"""Objects of a request that cameras see otherwise than light does."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..plugin.camera_masks import CameraMasks, SplatMasks
from ..support.errors import DataError
from ..support.wording import counted
from .mattes import NOTHING
from .objects import SurfaceObjects, object_of_primitive
from .request import SOURCE, Request


def is_masked(request: Request) -> bool:
    """Whether there are any."""
    return bool(request.holdout or request.indirect_only)


def require_counts(request: Request, n: int) -> None:
    """Raise ``DataError`` where the objects of the request have not ``n`` primitives."""
    if request.counts and sum(request.counts) != n:
        problem = f'"counts" adds up to {sum(request.counts):,}, the model has {counted(n, "primitive")}'
        raise DataError(SOURCE, problem, "give the number of primitives of each object")


def splat_masks(request: Request, n: int, chosen: np.ndarray | None = None) -> SplatMasks | None:
    """Of a model with ``n`` primitives, or of those that are ``chosen``; None where all are seen.

    Raises ``DataError`` where the objects of the request have not so many.
    """
    if not is_masked(request):
        return None
    require_counts(request, n)
    objects = object_of_primitive(np.arange(n) if chosen is None else chosen, request.counts)
    unseen, holdout = (np.isin(objects, numbers) for numbers in (request.indirect_only, request.holdout))
    return SplatMasks(mi.Bool(unseen), mi.Bool(holdout), bool(holdout.any())) if (unseen | holdout).any() else None


def hides_lamps(request: Request) -> bool:
    """Whether the camera sees no lamps; objects that shine are none."""
    return request.hide_lamps or request.transparent


def camera_masks(request: Request, scene: mi.Scene, n: int) -> CameraMasks | None:
    """Of a scene with ``n`` primitives; None where all is seen but what a camera passes that sees no emitters. Raises
    as ``splat_masks``."""
    objects = SurfaceObjects(scene)
    if not (is_masked(request) or (hides_lamps(request) and objects.shine)):
        return None
    unseen = _Among(objects, set(request.indirect_only) - set(request.holdout))
    return CameraMasks(splat_masks(request, n), unseen, _Among(objects, request.holdout), objects.is_lamp)


class _Among:
    """Whether what a ``mi.PreliminaryIntersection3f`` is of is one of these objects."""

    def __init__(self, objects: SurfaceObjects, numbers: Collection[int]):
        table = np.zeros(objects.largest + 1, bool)
        table[[number for number in numbers if number < len(table)]] = True
        self._objects, self._table = objects, mi.Bool(table)

    def __call__(self, meeting: Any) -> mi.Bool:
        number = self._objects.number(meeting)
        known = (number != NOTHING) & (number < dr.width(self._table))
        return dr.gather(mi.Bool, self._table, mi.UInt32(number), known)


def without_holdouts(numbers: np.ndarray, request: Request) -> np.ndarray:
    """Numbers of objects; those of holdouts are ``NOTHING``."""
    return np.where(np.isin(numbers, request.holdout), NOTHING, numbers).astype(numbers.dtype)
