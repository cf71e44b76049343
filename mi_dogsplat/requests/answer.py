"""The picture that a request asks for, in steps between which the one who asked may stop."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..render.denoise import correction
from ..support.errors import DataError
from ..support.scene_errors import scene_error
from .alone import SplatsAlone
from .data_passes import data_passes
from .gradual import in_steps, means
from .masks import require_counts
from .request import SOURCE, Request
from .scene_description import load_scene, number_of

BAND_PIXELS = 2**21  # of splats alone, between two steps: each band sorts all primitives
STEP_SAMPLES = 8  # per pixel of a scene, between two steps at least
Arrays = dict[str, np.ndarray]
Steps = Iterator[tuple[float, Arrays | None]]  # share that is done, and the picture so far where it is a whole one


class Answerer:
    """Draws one request after the other and keeps the model of the latest, which films look at again and again."""

    def __init__(self):
        self._key: tuple = ()
        self._splats: Any = None

    def answer(self, request: Request) -> Steps:
        """Steps of the picture; the last one is whole and has all passes. Needs a Mitsuba variant.

        Splats alone: ``color`` [H, W, 3] sRGB values over black, or radiance where the model is linear, and ``alpha``
        [H, W]; where there are holdouts also ``hole`` [H, W], their share, which is no part of alpha and behind which
        nothing shows. A scene: ``color`` is linear radiance, premultiplied with ``alpha``. Further those of
        ``data_passes`` that are asked for.

        Raises ``DataError``.
        """
        try:
            return (yield from self._scene(request) if request.scene else self._alone(request))
        except (RuntimeError, ValueError, TypeError) as error:
            if isinstance(error, DataError):
                raise
            source = request.scene or request.model or Path(SOURCE)
            raise scene_error(source, error, "cannot be drawn", "correct it") from error

    def _model(self, path: Path) -> Any:
        from ..shape_dog import DogShape  # of the active variant: another one after each change, there and back too

        try:
            status = path.stat()
        except OSError as error:
            raise DataError(path, f"cannot be read ({error.strerror})", "give a model") from error
        key = DogShape, path, status.st_mtime_ns, status.st_size
        if key != self._key:
            self._key, self._splats = (), None  # two of them need not be held at a time
            self._splats = mi.load_dict({"type": "dog", "filename": str(path)})
            self._key = key
        return self._splats

    def _alone(self, request: Request) -> Steps:
        """Band by band."""
        assert request.model and request.camera
        camera = request.camera
        alone, bands = SplatsAlone.of(request, self._model(request.model), camera), []
        rows = max(BAND_PIXELS // camera.width, 1)
        for top in range(0, camera.height, rows):
            bottom = min(top + rows, camera.height)
            bands.append(alone.rows(top, bottom))
            if bottom < camera.height:
                yield bottom / camera.height, None
        yield 1.0, {name: np.concatenate([found[name] for found in bands]) for name in bands[0]}

    def _scene(self, request: Request) -> Steps:
        """A few samples per pixel after the other."""
        splats = self._model(request.model) if request.model else None
        require_counts(request, number_of(splats))
        scene = load_scene(request, splats)
        sensor, picture = scene.sensors()[0], {}
        for mean in means(scene, sensor, request, in_steps(request.samples, STEP_SAMPLES)):
            picture = {"color": mean.picture[..., :3], "alpha": mean.picture[..., 3]}
            if mean.done < request.samples:
                yield mean.done / request.samples, picture
            elif mean.for_denoiser is not None:
                picture["color"] = picture["color"] + correction(mean.for_denoiser)
        if request.passes:
            picture |= data_passes(request, scene, splats)
        yield 1.0, picture
