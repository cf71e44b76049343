"""Meshes and other shapes between the splats: a nested integrator renders them, splats are blended in front of them."""

# The stubs of Mitsuba give plugins as their base classes.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false, reportOperatorIssue=false
from __future__ import annotations

from dataclasses import dataclass

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

    def behind(self, frame: Frame, colors: list) -> Frame:
        """``frame``, whose splats end at the surfaces, with the surfaces behind them.

        colors: those of the surfaces in the colour space of the frame.
        """
        T = dr.select(self.hit, frame.T, 0)  # what reaches a surface
        frame.colors = [dr.fma(T, behind, c) for c, behind in zip(frame.colors, colors, strict=True)]
        if frame.depth is not None:
            frame.depth = dr.fma(T, dr.select(self.hit, self.depth, 0), frame.depth)
        frame.T = dr.select(self.hit, 0, frame.T)
        return frame


def trace(nested: mi.Integrator, scene: mi.Scene, look: Look) -> Surfaces:
    """Trace the rays of a pass. ``dog`` shapes have no surface, so that rays do not meet them."""
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
        dr.eval(hit, depth, colors)
        return Surfaces(hit, depth, colors)
