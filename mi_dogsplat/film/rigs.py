"""Cameras that a rig had at one moment, or the sides of a panorama: a film goes along one of them, not along all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..scene.cameras import Camera


def one_of_each_moment(cameras: Sequence[Camera], moments: Sequence[int | None]) -> list[Camera]:
    """A camera of each moment, in the order in which these come first; one whose moment is None has its own.

    Each looks as nearly as can be where the one before looked. Of the ways that begin with a camera of the first moment
    it is the one along which most of the way lies ahead.
    """
    groups: dict[tuple[bool, int], list[Camera]] = {}
    for number, (camera, moment) in enumerate(zip(cameras, moments, strict=True)):
        groups.setdefault((moment is None, number if moment is None else moment), []).append(camera)
    if len(groups) == len(cameras):
        return list(cameras)
    first, *others = groups.values()
    return max((_going_on(camera, others) for camera in first), key=_ahead)


def _going_on(first: Camera, others: Sequence[Sequence[Camera]]) -> list[Camera]:
    """The camera and of each other moment that which is turned least from the one before."""
    way = [first]
    for group in others:
        rotation = way[-1].w2c[:3, :3]
        way.append(max(group, key=lambda camera: float((camera.w2c[:3, :3] * rotation).sum())))
    return way


def _ahead(way: Sequence[Camera]) -> float:
    """How far cameras go along their own views."""
    steps = np.diff([camera.position for camera in way], axis=0)  # [V - 1, 3]
    return float((steps * [camera.w2c[2, :3] for camera in way[:-1]]).sum())
