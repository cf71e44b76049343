"""Meshes and other shapes between the splats: a nested integrator renders them, splats are blended in front of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.rasterize import Frame
from .sensor import Look


@dataclass
class Surfaces:
    """The surfaces that the samples of a pass meet, as [H*W] planes."""

    hit: mi.Bool
    depth: mi.Float  # along the optical axis; infinite where nothing is hit
    colors: list  # 3 channels of linear radiance, without derivatives; 0 where nothing is hit
    normal: list  # 3 channels, shading normals in world space, turned to the camera; 0 where nothing is hit

    def behind(self, frame: Frame, colors: list) -> Frame:
        """``frame``, whose splats end at the surfaces, with the surfaces behind them.

        colors: those of the surfaces in the colour space of the frame.
        """
        T = dr.select(self.hit, frame.T, 0)  # what reaches a surface
        frame.colors = [dr.fma(T, behind, c) for c, behind in zip(frame.colors, colors, strict=True)]
        if frame.depth is not None:
            frame.depth = dr.fma(T, dr.select(self.hit, self.depth, 0), frame.depth)
        if frame.normal is not None:
            frame.normal = [dr.fma(T, behind, n) for n, behind in zip(frame.normal, self.normal, strict=True)]
        frame.T = dr.select(self.hit, 0, frame.T)
        return frame

    def median_depth(self, of_splats: mi.Float) -> mi.Float:
        """The AOV: what splats leave more than half of ends at the surface."""
        return dr.select(self.hit & (of_splats == 0), self.depth, of_splats)


def trace(nested: Any, scene: Any, look: Look, normal: bool = False) -> Surfaces:
    """Trace the rays of a pass. ``dog`` shapes have no surface, so that rays do not meet them.

    ``nested``: a Mitsuba integrator, in Python or not. ``normal``: normals are asked for; else they are 0.
    """
    with dr.suspend_grad():
        ray, camera = look.rays(), look.camera
        meeting = scene.ray_intersect_preliminary(mi.Ray3f(ray), coherent=True)
        hit = meeting.is_valid()
        axis, point = camera.rotation[2], ray.o + ray.d * meeting.t
        offset = zip(point, camera.position, camera.position_rest, strict=True)
        z = [a * ((p - c) - rest) for a, (p, c, rest) in zip(axis, offset, strict=True)]
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(look.sample.seed, dr.width(ray))
        if isinstance(nested, mi.ad.integrators.common.ADIntegrator):  # those in Python have another signature
            state = {"depth": mi.UInt32(0), "δL": None, "δaovs": None, "state_in": None, "active": mi.Bool(True)}
            spectrum = nested.sample(mode=dr.ADMode.Primal, scene=scene, sampler=sampler, ray=ray, **state)[0]
        else:
            spectrum = nested.sample(scene, sampler, ray)[0]
        channels = list(spectrum)
        colors = [dr.select(hit, c, 0) for c in (channels * 3 if len(channels) == 1 else channels)]
        depth = dr.select(hit, z[0] + z[1] + z[2], dr.inf)
        facing = mi.Normal3f(0)
        if normal:
            n = meeting.compute_surface_interaction(ray, mi.RayFlags.All, hit).sh_frame.n
            facing = dr.select(hit, dr.select(dr.dot(n, ray.d) > 0, -n, n), 0)
        dr.eval(hit, depth, colors, facing)
        return Surfaces(hit, depth, colors, list(facing))
