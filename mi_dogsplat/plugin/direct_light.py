"""Light that reaches a surface straight from emitters, or from captured lamps among the splats, by sampling them.

    Lr = β w f(ωi) Le T / p(ωi),   w = p² / (p² + p_bsdf²)

with the value f of the BSDF, cosine included, the light Le of what is sampled with the density p, and T of the splats
on the way. The weight w (Veach 1997, power heuristic) leaves to BSDF sampling, which ``light_paths.py`` does, what that
finds more surely. In derivatives w and β are constant, as the directions are.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
from mitsuba.python.ad.integrators.common import mis_weight

from ..tracing.tracer import SplatTracer
from .splat_lamps import SplatLamps
from .straight import transmittance
from .transfer import emitted, mean_of, spectrum_of


class DirectLight:
    """Notation and arguments as of ``LightPaths``. Surfaces are given as Mitsuba's interactions ``si``."""

    def __init__(self, scene: Any, tracer: SplatTracer, lamps: SplatLamps | None, linear: bool, straight: bool):
        self.scene, self.tracer, self.lamps, self.linear, self.straight = scene, tracer, lamps, linear, straight

    def reflected(self, si: Any, bsdf: Any, active: Any, β: Any, random: Any, attached: bool) -> Any:
        """Radiance that surfaces reflect of both: mi.Spectrum, with derivatives where it is ``attached``."""
        Lr = self._from_emitters(si, bsdf, active, β, random, attached)
        if self.lamps:
            smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
            of_lamps = self._from_lamps(si, smooth, β, random, attached)
            with dr.resume_grad(when=attached):
                Lr = Lr + of_lamps
        return Lr

    def _from_emitters(self, si: Any, bsdf: Any, active: Any, β: Any, random: Any, attached: bool) -> Any:
        """Light of emitters, as splats let it through, by sampling their directions; none on mirrors."""
        active = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        ds, weight = self.scene.sample_emitter_direction(si, random.next_2d(), not self.straight, active)
        active = active & (ds.pdf != 0)
        shadow = si.spawn_ray_to(ds.p)
        # Mitsuba puts these at the end of the surfaces, and splats may be farther
        infinite = mi.has_flag(ds.emitter.flags(), mi.EmitterFlags.Infinite)
        shadow.maxt = dr.select(infinite, dr.largest(mi.Float), shadow.maxt)
        with dr.resume_grad(when=attached):
            if attached:
                value = self.scene.eval_emitter_direction(si, ds, active)
                weight = dr.replace_grad(weight, value * dr.select(active, dr.rcp(ds.pdf), 0))
            left: Any = mi.Spectrum(1)
            if self.straight:
                left = transmittance(self.scene, si, ds.p, active, attached)
                active &= dr.any(dr.detach(left) != 0)
            value_bsdf, pdf_bsdf = bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(ds.d), active)
            mis = dr.select(ds.delta, 1, mis_weight(ds.pdf, pdf_bsdf * mean_of(dr.detach(left))))
            T = left * self.tracer.transmittance(shadow, active)
            return dr.select(active, β * dr.detach(mis) * value_bsdf * weight * T, 0)

    def _from_lamps(self, si: Any, active: Any, β: Any, random: Any, attached: bool) -> Any:
        """Light of splats by sampling the directions of lamps among them."""
        assert self.lamps
        d, pdf = self.lamps.sample(si.p, random.next_1d(), random.next_2d())
        active = active & (pdf > 0)
        ray = si.spawn_ray(d)
        meeting = self.scene.ray_intersect_preliminary(ray, active=active)
        ray.maxt = dr.select(meeting.is_valid(), meeting.t, dr.largest(mi.Float))
        with dr.resume_grad(when=attached):
            value, pdf_bsdf = si.bsdf().eval_pdf(mi.BSDFContext(), si, si.to_local(d), active)
            colors, T = self.tracer.gather(ray, active)
            weight = dr.detach(mis_weight(pdf, pdf_bsdf)) * dr.select(active, dr.rcp(pdf), 0)
            return dr.select(active, β * weight * value * spectrum_of(emitted(list(colors), T, self.linear)), 0)
