"""The picture that a request asks for, in steps between which the one who asked may stop."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..engine.aovs import options_for
from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..render.picture import Picture, render_picture
from ..scene.cameras import Camera
from ..scene.sh_basis import sh_degree_of
from ..support.errors import DataError
from ..support.scene_errors import scene_error
from .data_passes import data_passes, emptied
from .gradual import in_steps, means
from .masks import require_counts, splat_masks, without_holdouts
from .mattes import ranked
from .objects import object_of_primitive
from .request import SOURCE, Request
from .scene_description import drawn_of, load_scene, number_of

BAND_PIXELS = 2**21  # of splats alone, between two steps: each band sorts all primitives
STEP_SAMPLES = 8  # per pixel of a scene, between two steps at least
AOV_OF_PASS = {"depth": "depth", "normal": "normal", "object": "index", "matte": "index"}  # of splats alone
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
        shape, camera = self._model(request.model), request.camera
        require_counts(request, number_of(shape))
        drawn = drawn_of(request, shape)
        names = sorted({AOV_OF_PASS[name] for name in request.passes})
        degree = sh_degree_of(shape.sh_size)
        plain = RasterOptions(sh_degree=degree, antialiased=drawn.antialiased)
        options, bands = options_for(names, plain), []
        params, masks = shape.parameters, splat_masks(request, number_of(shape))
        if masks:
            params = masks.shown(params, drawn.linear)
        most = max(BAND_PIXELS // camera.width, 1)
        for top in range(0, camera.height, most):
            rows = min(most, camera.height - top)
            band = Camera(camera.w2c, camera.fx, camera.fy, camera.cx, camera.cy - top, camera.width, rows)
            film = (0.0, -float(top), float(camera.width), float(camera.height - top))
            how = {"film": film, "perspective": not request.orthographic}
            picture = render_picture(params, band, options, 0.0, drawn, names, **how)
            color = picture.color if picture.radiance is None else np.maximum(picture.radiance, 0)
            hole = np.zeros_like(picture.alpha)
            if masks:
                seen = DeviceCamera.upload(band, drawn.near_clip, **how)
                hole = masks.hole(params, seen, plain, None).numpy().reshape(hole.shape)
            alpha = picture.alpha - hole
            found = {"color": color, "alpha": alpha, **_planes(picture, alpha, request)}
            if picture.depth is not None:
                found["depth"] = np.where(picture.alpha > 0, picture.depth, np.inf)
            if masks and masks.holds:
                found = emptied(found, hole) | {"hole": hole}
            bands.append(found)
            if top + rows < camera.height:
                yield (top + rows) / camera.height, None
        yield 1.0, {name: np.concatenate([found[name] for found in bands]) for name in bands[0]}

    def _scene(self, request: Request) -> Steps:
        """A few samples per pixel after the other."""
        splats = self._model(request.model) if request.model else None
        require_counts(request, number_of(splats))
        scene = load_scene(request, splats)
        sensor, picture = scene.sensors()[0], {}
        for done, mean in means(scene, sensor, request, in_steps(request.samples, STEP_SAMPLES)):
            picture = {"color": mean[..., :3], "alpha": mean[..., 3]}
            if done < request.samples:
                yield done / request.samples, picture
        if request.passes:
            picture |= data_passes(request, scene, splats)
        yield 1.0, picture


def _planes(picture: Picture, alpha: np.ndarray, request: Request) -> Arrays:
    """AOVs of splats as passes; an object covers what all splats of a pixel cover where it is the first of them."""
    found = {}
    if "normal" in request.passes:
        found["normal"] = np.stack([picture.aovs[f"normal.{axis}"] for axis in "XYZ"], -1)
    if "index" in (AOV_OF_PASS[name] for name in request.passes):
        number = object_of_primitive(picture.aovs["index.I"].astype(np.int64), request.counts)
        number = without_holdouts(number, request)
        found["object"], found["matte"] = number, ranked([(number, alpha.clip(0, 1))])
    return {name: array for name, array in found.items() if name in request.passes}
