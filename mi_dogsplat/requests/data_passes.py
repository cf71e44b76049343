"""What a pixel of a scene knows besides its colour: splats and surfaces together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.aovs import channels, options_for
from ..engine.parameters import concatenate
from ..engine.rasterize import RasterOptions, rasterize
from ..plugin.samples import Sample, samples
from ..plugin.sensor import Look, SensorReader
from .mattes import NOTHING, ranked
from .request import Request

OBJECT = "object_"  # begins the id of a shape that is one, and its number follows: object_3, object_3_glass
MATTE_SAMPLES = 8  # per pixel


def data_passes(request: Request, scene: mi.Scene, splats: Any | None, near_clip: float) -> dict[str, np.ndarray]:
    """Those that the request asks for.

    At the centres of the pixels: ``depth`` [H, W] along the optical axis, infinite where nothing is; ``normal``
    [H, W, 3] in world space, turned to the camera; ``object`` [H, W], the number of the one that covers most. Averaged
    over the pixels: ``matte``, as in ``mattes.py``.

    Objects of splats come first, those of surfaces are numbered by their ids.
    """
    (view,) = SensorReader().views(scene.sensors()[0], near_clip)
    found = {}
    if set(request.passes) - {"matte"}:
        found = _centre(request, scene, splats, view.through(Sample()))
    if "matte" in request.passes:
        parts = []
        for sample in samples(MATTE_SAMPLES, request.seed):
            parts += _coverages(request, scene, splats, view.through(sample))
        found["matte"] = ranked([(number, weight / MATTE_SAMPLES) for number, weight in parts])
    return {name: found[name] for name in request.passes}


def object_of_primitive(index: np.ndarray, counts: Sequence[int]) -> np.ndarray:
    """The object of each primitive, [...], from ``counts`` of primitives, one object after the other."""
    ends = np.cumsum(counts or [np.iinfo(np.int64).max])
    return np.where(index >= 0, np.searchsorted(ends, index, side="right"), NOTHING).astype(np.int32)


def _centre(request: Request, scene: mi.Scene, splats: Any | None, look: Look) -> dict[str, np.ndarray]:
    with dr.suspend_grad():
        interaction, of_surface = _meet(scene, look)
        hit = interaction.is_valid()
        T, depth, normal, number = mi.Float(1), mi.Float(0), [mi.Float(0)] * 3, mi.Int32(NOTHING)
        surface_depth = dr.select(hit, _along_axis(look, interaction.p), dr.inf)
        if splats is not None:
            frame = _splats(request, splats, look, surface_depth)
            T, depth, normal = frame.T, frame.depth, frame.normal
            number = _object_of_primitive(frame, request.counts)
        number = dr.select(hit & ((number == NOTHING) | (T > 0.5)), of_surface, number)
        behind = dr.select(hit, T, 0)
        alpha = 1 - dr.select(hit, 0, T)
        depth = dr.select(alpha > 0, dr.fma(behind, dr.select(hit, surface_depth, 0), depth) / alpha, dr.inf)
        facing = interaction.sh_frame.n
        facing = dr.select(hit, dr.select(dr.dot(facing, look.rays().d) > 0, -facing, facing), 0)
        normal = mi.Vector3f(*(dr.fma(behind, f, n) for f, n in zip(facing, normal, strict=True)))
        normal = dr.select(dr.squared_norm(normal) > 0, dr.normalize(normal), 0)
    planes = {"depth": _array(depth, look), "object": _array(number, look)}
    return planes | {"normal": np.stack([_array(n, look) for n in normal], -1)}


def _coverages(
    request: Request, scene: mi.Scene, splats: Any | None, look: Look
) -> list[tuple[np.ndarray, np.ndarray]]:
    """(number, weight) [H, W] of the splats and of the surface that one sample sees."""
    with dr.suspend_grad():
        interaction, of_surface = _meet(scene, look)
        hit = interaction.is_valid()
        T = mi.Float(1)
        found = []
        if splats is not None:
            frame = _splats(request, splats, look, dr.select(hit, _along_axis(look, interaction.p), dr.inf))
            T = dr.clip(frame.T, 0, 1)
            found.append((_array(_object_of_primitive(frame, request.counts), look), _array(1 - T, look)))
        found.append((_array(of_surface, look), _array(dr.select(hit, T, 0), look)))
    return found


def _splats(request: Request, splats: Any, look: Look, stop: mi.Float) -> Any:
    """The splats in front of the surfaces."""
    params, sh_size = concatenate([splats.parameters], [splats.sh_size])
    degree, antialiased = (1, 4, 9, 16).index(sh_size), request.antialiased
    if antialiased is None:
        antialiased = bool(splats.drawing.antialiased)
    options = options_for(["depth", "normal", "index"], RasterOptions(sh_degree=degree, antialiased=antialiased))
    return rasterize(params, look.camera, options, None, None, False, stop)


def _along_axis(look: Look, points: Any) -> mi.Float:
    axis, camera = look.camera.rotation[2], look.camera
    centre = [camera.position[k] + camera.position_rest[k] for k in range(3)]
    return sum((a * (p - c) for a, p, c in zip(axis, points, centre, strict=True)), mi.Float(0))


def _object_of_primitive(frame: Any, counts: Sequence[int]) -> mi.Int32:
    (index,) = channels(["index"], frame)
    return mi.Int32(object_of_primitive(mi.Int32(index).numpy(), counts))


def _meet(scene: mi.Scene, look: Look) -> tuple[Any, mi.Int32]:
    """(where the rays meet an object, its number); they pass through lamps, which are none."""
    numbers: dict[int, int] = {0: NOTHING}
    for shape in scene.shapes():  # as the registry of Dr.Jit numbers them
        pointer: Any = dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))
        (slot,) = pointer.numpy().tolist()
        name = shape.id()
        numbers[slot] = int(name.split("_")[1]) if name.startswith(OBJECT) else NOTHING
    values = np.full(max(numbers) + 1, NOTHING, np.int32)
    values[list(numbers)] = list(numbers.values())
    table, ray, anywhere = mi.Int32(values), mi.Ray3f(look.rays()), cast(Any, scene)

    def meet(origin: Any, active: Any = True) -> Any:
        return anywhere.ray_intersect(mi.Ray3f(origin, ray.d), active=mi.Bool(active))

    def number(si: Any) -> mi.Int32:
        """An instance counts for what it repeats."""
        pointers: Any = [dr.reinterpret_array(mi.UInt32, p) for p in (si.shape, si.instance)]
        of_shape, of_instance = pointers
        slot: Any = dr.select(of_instance != 0, of_instance, of_shape)
        return dr.select(slot < len(values), dr.gather(mi.Int32, table, slot, slot < len(values)), NOTHING)

    def step(origin: Any, active: Any) -> tuple:
        si = meet(origin, active)
        active &= si.is_valid() & (number(si) == NOTHING)
        return dr.select(active, si.spawn_ray(ray.d).o, origin), active

    loop: Any = dr.while_loop
    start = (ray.o, dr.full(mi.Bool, True, dr.width(ray)))
    origin = loop(start, lambda origin, active: active, step, label="lamps")[0]
    si = meet(origin)
    return si, dr.select(si.is_valid(), number(si), NOTHING)


def _array(values: Any, look: Look) -> np.ndarray:
    size = look.camera.height, look.camera.width
    return np.broadcast_to(values.numpy(), size[0] * size[1]).reshape(size)
