"""What a scene looks like while a viewport moves: its surfaces by a lamp at the camera, splats in front of them."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..integrator import DogSplatIntegrator

LEAST = 0.3  # of the light on what is seen from the side
WITHOUT_ALBEDO = 0.5  # mirrors and glass


class Headlight(mi.SamplingIntegrator):
    """The colour of a surface without shadows, and its own light: no noise, and one ray for a pixel."""

    def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Any:
        si = scene.ray_intersect(mi.Ray3f(ray), active=mi.Bool(active))
        albedo = si.bsdf(ray).eval_diffuse_reflectance(si, si.is_valid())
        albedo = dr.select(dr.max(albedo) > 0, dr.clip(albedo, 0, 1), WITHOUT_ALBEDO)
        facing = abs(dr.dot(si.sh_frame.n, ray.d))
        shade = albedo * dr.fma(1 - LEAST, facing, LEAST)
        light = si.emitter(scene).eval(si, si.is_valid())
        return dr.select(si.is_valid(), shade + light, 0), si.is_valid(), []


class QuickIntegrator(DogSplatIntegrator):
    """``dogsplat`` over ``Headlight``; ``hide_lamps``: the camera does not see shapes that emit light."""

    def __init__(self, drawing: dict[str, Any], transparent: bool, hide_lamps: bool):
        props = mi.Properties()
        for name, value in {**drawing, "hide_emitters": transparent}.items():
            props[name] = value
        super().__init__(props)
        self.nested, self._hide_lamps = Headlight(mi.Properties()), hide_lamps

    def hidden_lights(self) -> bool:
        return self._hide_lamps
