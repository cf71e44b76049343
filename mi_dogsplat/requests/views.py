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
from ..engine.rasterize import Frame, rasterize
from ..plugin.denoising import CHANNELS
from ..plugin.transfer import linear_to_srgb, srgb_to_linear
from ..render.denoise import correction
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs, drawn_as
from ..support.errors import DataError, interruptible
from ..support.scene_errors import scene_error
from .gradual import Mean, finished, in_steps, means
from .masks import camera_masks, hides_lamps, splat_masks
from .request import SOURCE
from .scene_description import files_of, load_scene, no_splats, number_of
from .shares import Shares
from .view_request import ViewRequest
from .view_sensor import picture_of, sensor_of

STEP_SAMPLES = 2  # of a scene, between two pictures after the first
DENOISER_SAMPLES = 3  # that take as long as the denoiser
BAND_PIXELS = 100_000  # of a scene, between two looks whether another picture is wanted
Steps = Iterator[tuple[float, np.ndarray]]  # share that is done, and the picture so far


class Views:
    """Draws one request after the other; models and scenes are read again where their files are others."""

    def __init__(self):
        self._kept: dict[str, tuple[tuple, Any]] = {}  # what was made of files: signature and value

    def frames(self, request: ViewRequest, interrupted: Callable[[], bool] = lambda: False) -> Steps:
        """The picture in steps, [H, W, 4] float32, premultiplied; the last is finished unless it was interrupted.

        ``interrupted`` is asked between two parts of the paths of a scene. Needs a Mitsuba variant. Raises
        ``DataError``.
        """
        try:
            yield from self._scene(request, interrupted) if request.scene else self._alone(request)
        except (RuntimeError, ValueError, TypeError) as error:
            if isinstance(error, DataError):
                raise
            source = request.scene or request.model or Path(SOURCE)
            raise scene_error(source, error, "cannot be drawn", "correct it") from error

    def _keep(self, name: str, files: list[Path], also: tuple, make: Callable[[], Any]) -> Any:
        """What ``make`` makes of files, until one of them or ``also`` is another."""
        from ..shape_dog import DogShape  # of the active variant: another one after each change, there and back too

        signature = DogShape, *map(_signature, files), *also
        if name not in self._kept or self._kept[name][0] != signature:
            self._kept.pop(name, None)
            self._kept[name] = signature, make()
        return self._kept[name][1]

    def _alone(self, request: ViewRequest) -> Steps:
        path, camera = request.model, request.camera
        assert path and camera
        model: Shares = self._keep("model", [path], (), lambda: Shares(path))
        drawn = drawn_as(request.drawing, model.drawing)
        how = {"film": request.film, "perspective": not request.orthographic}
        seen = DeviceCamera.upload(camera, drawn.near_clip, **how)
        options = RasterOptions(sh_degree=model.splats.sh_degree, antialiased=drawn.antialiased)
        params, hole = model.part(request.share), None
        if masks := splat_masks(request, model.splats.n_splats, model.chosen(request.share)):
            params = masks.shown(params, drawn.linear)
            hole = masks.hole(params, seen, options, None)
        pixels: Any = dr.ravel(mi.Vector4f(*_colors_and_alpha(request, rasterize(params, seen, options), drawn, hole)))
        yield 1.0, pixels.numpy().reshape(camera.height, camera.width, 4)

    def _scene(self, request: ViewRequest, interrupted: Callable[[], bool]) -> Steps:
        sensor, camera = sensor_of(request), request.camera
        assert camera
        files = [path for path in (request.scene, request.model) if path]
        named = self._keep("files", files[:1], (), lambda: files_of(files[0]))
        how = request.max_depth, request.transparent, request.hide_lamps, request.denoise
        drawn = request.near_clip, request.antialiased, request.mesh_shadows
        masked = request.counts, request.holdout, request.indirect_only
        also = how + drawn + masked + tuple(_stamp(file) for file in named)
        scene, quick = self._keep("scene", files, also, lambda: self._load(request, sensor))
        integrator: Any = scene.integrator()
        if not request.samples:
            quick.picture = request.film
            with interruptible():
                picture = np.array(mi.render(scene, sensor=sensor, integrator=quick, spp=1), np.float32)
            yield 1.0, finished(picture, request)
            return
        bands = [(rows, self._means(scene, request, rows)) for rows in _bands(camera)]
        picture, given = (np.zeros((camera.height, camera.width, k), np.float32) for k in (4, len(CHANNELS)))
        done, work = 0, request.samples + (DENOISER_SAMPLES if request.denoise else 0)
        while done < request.samples:
            for rows, steps in bands:
                if interrupted():
                    return
                if hasattr(integrator, "picture"):  # ours
                    integrator.picture = picture_of(request, rows)
                done, picture[rows], for_denoiser = next(steps)
                if for_denoiser is not None:
                    given[rows] = for_denoiser
            yield done / work, picture.copy()
        if request.denoise:
            picture[..., :3] += correction(given, lambda: not interrupted())
            if not interrupted():
                yield 1.0, picture

    def _means(self, scene: mi.Scene, request: ViewRequest, rows: slice) -> Iterator[Mean]:
        """Of some rows: a sample for each pixel, then a few more at a time."""
        return means(scene, sensor_of(request, rows), request, in_steps(request.samples, STEP_SAMPLES, 1), rows.start)

    def _load(self, request: ViewRequest, sensor: mi.Sensor) -> tuple[mi.Scene, mi.Integrator]:
        """The scene with the integrator of its paths, and the one for views that move."""
        from .headlight import QuickIntegrator  # of the active variant

        splats = self._shape(request.model)
        scene = load_scene(request, splats, sensor)
        quick = QuickIntegrator(request.drawing.said(), request.transparent, hides_lamps(request))
        quick.masks = camera_masks(request, scene, number_of(splats))
        return scene, quick

    def _shape(self, path: Path | None) -> Any:
        """The model, or one without primitives."""
        if path is None:
            return no_splats()
        return self._keep("shape", [path], (), lambda: mi.load_dict({"type": "dog", "filename": str(path)}))


def _colors_and_alpha(request: ViewRequest, frame: Frame, drawn: DrawnAs, hole: Any) -> list:
    """Four columns of the pixels: colours as the request asks for them, linear or not, over its background if it has
    one, and alpha without the ``hole``, which is None where no object cuts one."""
    colors, alpha = [dr.maximum(c, 0) if drawn.linear else dr.clip(c, 0, 1) for c in frame.colors], 1 - frame.T
    if request.background is not None:
        behind = [dr.opaque(mi.Float, value) for value in request.background]
        colors = [dr.fma(frame.T, b, c) for c, b in zip(colors, behind, strict=True)]
        alpha = dr.full(mi.Float, 1, dr.width(frame.T))
    alpha = alpha if hole is None else alpha - hole
    if request.linear and not drawn.linear:
        share = dr.maximum(alpha, 1e-6)  # of the pixel, of which colours are the mean
        if request.background is None:  # negative lobes may take more alpha than colour: then white, as in a file
            colors = [dr.minimum(c, share) for c in colors]
        colors = [share * c for c in srgb_to_linear([c / share for c in colors])]
    elif drawn.linear and not request.linear:
        white = dr.opaque(mi.Float, drawn.white)
        colors = [dr.clip(c, 0, 1) for c in linear_to_srgb([c / white for c in colors])]
    return [*colors, alpha]


def _bands(camera: Camera) -> list[slice]:
    """Rows that are drawn at a time, so that a view that moves waits for no more.

    As many in each, or kernels would be compiled for the last: it may draw some rows again.
    """
    count = min(max(BAND_PIXELS // camera.width, 1), camera.height)
    tops = (min(top, camera.height - count) for top in range(0, camera.height, count))
    return [slice(top, top + count) for top in tops]


def _signature(path: Path) -> tuple:
    try:
        return _stamp(path, missing=False)
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror})", "give a model or a scene") from error


def _stamp(path: Path, missing: bool = True) -> tuple:
    """What tells a file from what it was. Of one that is ``missing`` Mitsuba says so when it loads it; otherwise raises
    ``OSError``."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        if missing:
            return (path,)
        raise
    return path, status.st_mtime_ns, status.st_size
