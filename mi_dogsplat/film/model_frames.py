"""A model as frames of a film: one picture, or the mean of some while the shutter is open."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..render.picture import Picture, picture_of
from ..scene.cameras import Camera
from ..support.pictures import write_exr
from .exposure import exposed
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
