"""What a pixel of a scene knows besides its colour: splats and surfaces together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.aovs import channels, options_for
from ..engine.options import RasterOptions
from ..engine.parameters import concatenate
from ..engine.rasterize import Frame, rasterize
from ..plugin.camera_masks import CameraMasks
from ..plugin.samples import Sample, samples
from ..plugin.sensor import SensorReader, ViewPass
from ..plugin.surfaces import Surfaces, meet
from .masks import camera_masks, without_holdouts
from .mattes import NOTHING, ranked
from .objects import SurfaceObjects, object_of_primitive
from .request import Request
from .scene_description import drawn_of, number_of

MATTE_SAMPLES = 8  # per pixel


def data_passes(request: Request, scene: mi.Scene, splats: Any | None) -> dict[str, np.ndarray]:
    """Those that the request asks for.

    At the centres of the pixels: ``depth`` [H, W] along the optical axis, infinite where nothing is; ``normal``
    [H, W, 3] in world space, turned to the camera; ``object`` [H, W], the number of the one that covers most. Averaged
    over the pixels: ``matte``, as in ``mattes.py``.

    Objects of splats come first, those of surfaces are numbered by their ids. Where holdouts cover most of a pixel
    nothing is.
    """
    (view,) = SensorReader().views(scene.sensors()[0], drawn_of(request, splats).near_clip)
    masks = camera_masks(request, scene, number_of(splats))
    seen, found = _Seen(request, SurfaceObjects(scene), scene, splats, masks), {}
    with dr.suspend_grad():
        if set(request.passes) - {"matte"}:
            found = _centre(seen, view.through(Sample()))
        if "matte" in request.passes:
            parts = []
            for sample in samples(MATTE_SAMPLES, request.seed):
                parts += _coverages(seen, view.through(sample))
            found["matte"] = ranked([(number, weight / MATTE_SAMPLES) for number, weight in parts])
    return {name: found[name] for name in request.passes}


@dataclass(frozen=True)
class _Seen:
    """What the passes look at."""

    request: Request
    objects: SurfaceObjects
    scene: mi.Scene
    splats: Any | None
    masks: CameraMasks | None

    def surfaces(self, view_pass: ViewPass, normal: bool = False) -> Surfaces:
        """Those of objects; rays pass through lamps, which are none."""

        def is_lamp(meeting: Any) -> mi.Bool:
            return self.objects.number(meeting) == NOTHING

        return meet(self.scene, view_pass, normal, self.masks.passed(is_lamp) if self.masks else is_lamp)

    def in_front(self, view_pass: ViewPass, stop: mi.Float, names: Sequence[str]) -> tuple[Frame, mi.Int32, mi.Float]:
        """(the splats in front of the surfaces with these AOVs, the number of the object that covers most, the share
        of holdouts)."""
        hole = zero = dr.zeros(mi.Float, dr.width(stop))
        if self.splats is None:
            return Frame([zero] * 3, zero + 1, zero, [zero] * 3), mi.Int32(NOTHING), hole
        params, _ = concatenate([self.splats.parameters], [self.splats.sh_size])
        antialiased = drawn_of(self.request, self.splats).antialiased
        options = options_for(names, RasterOptions(sh_degree=0, antialiased=antialiased))  # colours are not asked for
        if self.masks and self.masks.splats:
            params = self.masks.splats.shown(params, True)
            hole = self.masks.splats.hole(params, view_pass.camera, options, stop)
        frame = rasterize(params, view_pass.camera, options, None, None, False, stop)
        (index,) = channels(["index"], frame)
        return frame, mi.Int32(object_of_primitive(mi.Int32(index).numpy(), self.request.counts)), hole


def _centre(seen: _Seen, view_pass: ViewPass) -> dict[str, np.ndarray]:
    surfaces = seen.surfaces(view_pass, normal=True)
    frame, number, hole = seen.in_front(view_pass, surfaces.depth, ["depth", "normal"])
    if seen.masks:
        hole += dr.select(surfaces.hit & seen.masks.holdout(surfaces.meeting), frame.T, 0)
    behind = surfaces.hit & ((number == NOTHING) | (frame.T > 0.5))
    number = dr.select(behind, seen.objects.number(surfaces.meeting), number)
    frame = surfaces.behind(frame)
    assert frame.depth is not None and frame.normal is not None
    alpha = 1 - frame.T
    depth = dr.select(alpha > 0, frame.depth / alpha, dr.inf)
    normal = mi.Vector3f(frame.normal)
    normal = dr.select(dr.squared_norm(normal) > 0, dr.normalize(normal), 0)
    planes = {"depth": _array(depth, view_pass), "object": without_holdouts(_array(number, view_pass), seen.request)}
    planes["normal"] = np.stack([_array(n, view_pass) for n in normal], -1)
    return emptied(planes, _array(hole, view_pass)) if seen.masks else planes


def _coverages(seen: _Seen, view_pass: ViewPass) -> list[tuple[np.ndarray, np.ndarray]]:
    """(number, weight) [H, W] of the splats and of the surface that one sample sees."""
    surfaces = seen.surfaces(view_pass)
    frame, number, hole = seen.in_front(view_pass, surfaces.depth, [])
    T = dr.clip(frame.T, 0, 1)
    of_surface = seen.objects.number(surfaces.meeting)
    parts = [(number, 1 - T - hole), (of_surface, dr.select(surfaces.hit, T, 0))]
    in_picture = [[_array(part, view_pass) for part in of_one] for of_one in parts]
    return [(without_holdouts(number, seen.request), weight) for number, weight in in_picture]


def emptied(planes: dict[str, np.ndarray], hole: np.ndarray) -> dict[str, np.ndarray]:
    """Planes, of which depth, normal and object tell of nothing where holdouts, [H, W], cover most of a pixel."""
    empty, nothing = hole > 0.5, {"depth": np.inf, "normal": 0, "object": NOTHING}
    shaped = {name: empty[..., None] if plane.ndim > 2 else empty for name, plane in planes.items()}
    values = {name: np.where(shaped[name], nothing[name], planes[name]) for name in planes.keys() & nothing}
    return planes | {name: value.astype(planes[name].dtype) for name, value in values.items()}


def _array(values: Any, view_pass: ViewPass) -> np.ndarray:
    size = view_pass.camera.height, view_pass.camera.width
    return np.broadcast_to(values.numpy(), size[0] * size[1]).reshape(size)
