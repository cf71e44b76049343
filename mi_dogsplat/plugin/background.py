"""What shows behind the splats: the constant or environment emitter of the scene."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .transfer import three_channels


def radiance(environment: mi.Emitter, ray: mi.Ray3f) -> list[mi.Float]:
    """Linear radiance that comes against each ray, three channels. Differentiable: emitter, and directions of rays."""
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(ray))
    si.wi = -ray.d
    si.wavelengths = ray.wavelengths
    return three_channels(environment.eval(si))
