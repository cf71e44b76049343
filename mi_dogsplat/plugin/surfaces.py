"""The surfaces that the rays of a pass meet: splats end there, and something else says what they look like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.arrays import while_loop
from ..engine.rasterize import Frame
from .samples import Sample
from .sensor import ViewPass
from .transfer import three_channels


@dataclass
class Surfaces:
    """The surfaces that the samples of a pass meet, as [H*W] planes."""

    ray: Any  # mi.RayDifferential3f, through the samples
    sample: Sample  # the pass
    hit: mi.Bool
    depth: mi.Float  # along the optical axis; infinite where nothing is hit
    normal: list  # 3 channels, shading normals in world space, turned to the camera; 0 where nothing is hit
    meeting: Any  # mi.PreliminaryIntersection3f
    medium: Any  # mi.Medium, around the sensor; None without
    clear: Any = None  # share of what reaches them that passes straight on to where nothing is; None: of all 0
    for_denoiser: list | None = None  # planes of ``denoising.py``, where they are asked for

    def behind(self, frame: Frame) -> Frame:
        """``frame``, whose splats end at the surfaces, with the surfaces behind them in all but the colours."""
        T = dr.select(self.hit, frame.T, 0)  # what reaches a surface
        if frame.depth is not None:
            frame.depth = dr.fma(T, dr.select(self.hit, self.depth, 0), frame.depth)
        if frame.normal is not None:
            frame.normal = [dr.fma(T, behind, n) for n, behind in zip(frame.normal, self.normal, strict=True)]
        frame.T = dr.select(self.hit, 0 if self.clear is None else frame.T * self.clear, frame.T)
        return frame

    def median_depth(self, of_splats: mi.Float) -> mi.Float:
        """The AOV: what splats leave more than half of ends at the surface."""
        return dr.select(self.hit & (of_splats == 0), self.depth, of_splats)


def emits(meeting: Any) -> mi.Bool:
    """Whether the shape of a ``mi.PreliminaryIntersection3f`` is an emitter."""
    return meeting.shape.emitter() != dr.zeros(mi.EmitterPtr)


def meet(
    scene: Any, view_pass: ViewPass, normal: bool = False, passed: Callable[[Any], mi.Bool] | None = None
) -> Surfaces:
    """Intersect the rays of a pass. ``dog`` shapes have no surface, so that rays do not meet them.

    normal: normals are asked for; else they are 0.
    passed: rays start behind what lies in front of everything else and is such a ``mi.PreliminaryIntersection3f``.
    """
    with dr.suspend_grad():
        ray, camera = view_pass.rays(), view_pass.camera
        if passed:
            start = _behind(passed, scene, ray)
            ray.maxt = dr.maximum(ray.maxt - dr.dot(start - ray.o, ray.d), 0)  # the far clip stays where it is
            ray.o = start
        meeting = scene.ray_intersect_preliminary(mi.Ray3f(ray), coherent=True)
        hit = meeting.is_valid()
        axis, point = camera.rotation[2], ray.o + ray.d * meeting.t
        z = [a * of_axis for a, of_axis in zip(axis, camera.offset(point), strict=True)]
        depth = dr.select(hit, z[0] + z[1] + z[2], dr.inf)
        facing = mi.Normal3f(0)
        if normal:
            n = meeting.compute_surface_interaction(ray, mi.RayFlags.All, hit).sh_frame.n
            facing = dr.select(hit, dr.select(dr.dot(n, ray.d) > 0, -n, n), 0)
        dr.eval(hit, depth, facing)
        return Surfaces(ray, view_pass.sample, hit, depth, list(facing), meeting, view_pass.sensor.get_medium())


def radiance(nested: Any, scene: Any, seen: Surfaces, by_modes: bool) -> list[mi.Float]:
    """Linear radiance of the surfaces by a nested integrator, in Python or not; no derivatives, 0 beside them.

    by_modes: it is an ``ADIntegrator``, whose ``sample`` has another signature.
    """
    with dr.suspend_grad():
        sampler: Any = mi.load_dict({"type": "independent"})
        sampler.seed(seen.sample.seed, dr.width(seen.ray))
        if by_modes:
            state = {"depth": mi.UInt32(0), "δL": None, "δaovs": None, "state_in": None, "active": mi.Bool(True)}
            spectrum = nested.sample(mode=dr.ADMode.Primal, scene=scene, sampler=sampler, ray=seen.ray, **state)[0]
        else:
            spectrum = nested.sample(scene, sampler, seen.ray, seen.medium, mi.Bool(True))[0]
        colors = [dr.select(seen.hit, c, 0) for c in three_channels(spectrum)]
        dr.eval(colors)
        return colors


def _behind(passed: Callable[[Any], mi.Bool], scene: Any, ray: Any) -> Any:
    """Where rays start that pass through some of the surfaces in front of everything else."""

    def at_passed(o, active):
        meeting = scene.ray_intersect_preliminary(mi.Ray3f(o, ray.d), active=active)
        at = meeting.is_valid() & passed(meeting)
        return meeting.compute_surface_interaction(mi.Ray3f(o, ray.d), mi.RayFlags.Minimal, at & active), at & active

    def step(o, active):
        si, active = at_passed(o, active)
        return dr.select(active, si.spawn_ray(ray.d).o, o), active

    return while_loop((ray.o, mi.Bool(True)), lambda o, active: active, step, "passed surfaces")[0]
