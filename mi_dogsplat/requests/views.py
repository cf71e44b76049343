"""Pictures for viewports: from what stays on the device between them, so that a frame needs no more than its camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..engine.rasterize import rasterize
from ..plugin.transfer import linear_to_srgb, srgb_to_linear
from ..scene.splats import DENSE, Splats
from ..support.errors import DataError, gist
from .gradual import means
from .headlight import QuickIntegrator
from .request import SOURCE
from .scene_description import load_scene
from .shares import Shares
from .view_request import ViewRequest
from .view_sensor import sensor_of

STEP_SAMPLES = 2  # of a scene, between two pictures
Steps = Iterator[tuple[float, np.ndarray]]  # share that is done, and the picture so far


class Views:
    """Draws one request after the other; models and scenes are read again where their files are others."""

    def __init__(self):
        self._kept: dict[str, tuple[tuple, Any]] = {}  # what was made of files: signature and value

    def frames(self, request: ViewRequest, interrupted: Callable[[], bool] = lambda: False) -> Steps:
        """The picture in steps, [H, W, 4] float32, premultiplied; the last is finished unless it was interrupted.

        ``interrupted`` is asked between two samples of a scene; the first picture is always made. Needs a Mitsuba
        variant. Raises ``DataError``.
        """
        try:
            yield from self._scene(request, interrupted) if request.scene else self._alone(request)
        except (RuntimeError, ValueError, TypeError) as error:
            if isinstance(error, DataError):
                raise
            source = request.scene or request.model or SOURCE
            raise DataError(source, f"cannot be drawn ({gist(error)})", "correct it") from error

    def _keep(self, name: str, files: list[Path], also: tuple, make: Callable[[], Any]) -> Any:
        """What ``make`` makes of files, until one of them or ``also`` is another."""
        signature = mi.variant(), *map(_signature, files), *also
        if name not in self._kept or self._kept[name][0] != signature:
            self._kept.pop(name, None)
            self._kept[name] = signature, make()
        return self._kept[name][1]

    def _alone(self, request: ViewRequest) -> Steps:
        path, camera = request.model, request.camera
        assert path and camera
        model: Shares = self._keep("model", [path], (), lambda: Shares(path))
        antialiased = model.drawing.antialiased if request.antialiased is None else request.antialiased
        near = model.drawing.near_clip if request.near_clip is None else request.near_clip
        seen = DeviceCamera.upload(camera, near, perspective=not request.orthographic)
        options = RasterOptions(sh_degree=model.splats.sh_degree, antialiased=antialiased)
        frame = rasterize(model.part(request.share), seen, options)
        colors = frame.colors
        if model.drawing.linear:
            colors = linear_to_srgb([c / model.drawing.white for c in colors])
        colors, alpha = [dr.clip(c, 0, 1) for c in colors], 1 - frame.T
        if request.background is not None:
            behind = [dr.opaque(mi.Float, value) for value in request.background]
            colors = [dr.fma(frame.T, b, c) for c, b in zip(colors, behind, strict=True)]
            alpha = dr.full(mi.Float, 1, dr.width(frame.T))
        if request.linear:
            colors = srgb_to_linear(colors)
        pixels: Any = dr.ravel(mi.Vector4f(*colors, alpha))
        yield 1.0, pixels.numpy().reshape(camera.height, camera.width, 4)

    def _scene(self, request: ViewRequest, interrupted: Callable[[], bool]) -> Steps:
        sensor = sensor_of(request)
        files = [path for path in (request.scene, request.model) if path]
        how = request.max_depth, request.transparent, request.hide_lamps, request.near_clip, request.antialiased
        scene, quick = self._keep("scene", files, how, lambda: self._load(request, sensor))
        if not request.samples:
            picture = np.array(mi.render(scene, sensor=sensor, integrator=quick, spp=1), np.float32)
            if not request.transparent:
                picture[..., 3] = 1
            yield 1.0, picture
            return
        for done, mean in means(scene, sensor, request, STEP_SAMPLES):
            yield done / request.samples, mean
            if interrupted():
                return

    def _load(self, request: ViewRequest, sensor: mi.Sensor) -> tuple[mi.Scene, mi.Integrator]:
        """The scene with the integrator of its paths, and the one for views that move."""
        splats = self._shape(request.model)
        drawing = {"near_clip": request.near_clip, "antialiased": request.antialiased}
        said = {name: value for name, value in drawing.items() if value is not None}
        hidden = request.hide_lamps or request.transparent
        return load_scene(request, splats, sensor), QuickIntegrator(said, request.transparent, hidden)

    def _shape(self, path: Path | None) -> Any:
        """The model, or one without primitives."""
        if path is None:
            empty = Splats.empty(0)
            return mi.load_dict({"type": "dog", **{name: mi.TensorXf(getattr(empty, name)) for name in DENSE}})
        return self._keep("shape", [path], (), lambda: mi.load_dict({"type": "dog", "filename": str(path)}))


def _signature(path: Path) -> tuple:
    try:
        status = path.stat()
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror})", "give a model or a scene") from error
    return path, status.st_mtime_ns, status.st_size
