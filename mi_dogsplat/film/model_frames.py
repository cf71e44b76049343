"""A model as frames of a film: one picture, or the mean of some while the shutter is open."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..render.picture import Picture, picture_of, premultiplied
from ..scene.cameras import Camera
from ..support.pictures import write_exr
from ..support.srgb import displayed, linear_to_srgb, srgb_to_linear
from .subject import Subject


class ModelFrames:
    """``Frames`` of a model. Needs a Mitsuba variant.

    transparent: they have alpha, and nothing is behind the model.
    """

    def __init__(self, subject: Subject, transparent: bool):
        self._subject, self._transparent = subject, transparent
        # what is behind would clamp what is brighter than it leaves room for
        self._background = 0.0 if transparent else subject.background
        self._picture: Callable[[Camera], Picture] = picture_of(subject.model.splats, self._background, subject.drawn)

    def image(self, number: int, cameras: Sequence[Camera], goes_on: Callable[[], None]) -> np.ndarray:
        """Display values [H, W, 3]."""
        return exposed(self._picture, cameras, self._background, False)

    def write_exr(self, file: Path, number: int, cameras: Sequence[Camera], goes_on: Callable[[], None]) -> None:
        """Linear colour, premultiplied with alpha."""
        write_exr(file, {"color": exposed(self._picture, cameras, self._background, True)})

    def settings(self) -> dict[str, Any]:
        """The model, and how it is drawn."""
        splats, digest = self._subject.model.splats, hashlib.sha256()
        for field in dataclasses.fields(splats):
            digest.update(np.ascontiguousarray(getattr(splats, field.name)).data)
        drawn = {"background": self._subject.background, **dataclasses.asdict(self._subject.drawn)}
        return {"model_sha256": digest.hexdigest(), **drawn}


def exposed(
    picture: Callable[[Camera], Picture], cameras: Sequence[Camera], background: float, alpha: bool
) -> np.ndarray:
    """float32 [H, W, 3] over the grey ``background``, or premultiplied [H, W, 4] without it if ``alpha``; 0..1.

    Several cameras are the moments of one exposure: light adds up, so the mean is that of linear radiance, and comes
    back as display values.
    """
    if len(cameras) == 1:
        return _image(picture(cameras[0]), background, alpha)
    total: np.ndarray | float = 0.0
    white = None
    for camera in cameras:
        seen = picture(camera)
        if seen.radiance is not None and not alpha:  # not clamped yet
            total, white = total + seen.radiance, seen.white
            continue
        image = _image(seen, background, alpha)
        total = total + np.concatenate([srgb_to_linear(image[..., :3]), image[..., 3:]], axis=-1)
    mean = np.asarray(total) / len(cameras)
    if white is not None:
        return displayed(mean, white)
    return np.concatenate([linear_to_srgb(mean[..., :3]), mean[..., 3:]], axis=-1).astype(np.float32)


def _image(picture: Picture, background: float, alpha: bool) -> np.ndarray:
    return premultiplied(picture, background) if alpha else picture.color
