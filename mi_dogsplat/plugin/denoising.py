"""What a denoiser is given: the part of a picture that has noise, and what it looks for edges in.

Splats in front of the camera have no noise. So only what light paths bring is to be smoothed, T L' in docs/dogpath.md,
and no edge or texture of the splats is.

Guides are the albedo and normal of the first surface that is neither a mirror nor clear glass. What those show of
splats and emitters counts as albedo, so that their reflections keep edges as well.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from .transfer import mean_of, three_channels
from .wavefront import add_to

AOV = "denoising"  # that asks for the channels
CHANNELS = tuple(
    f"{AOV}.{name}.{part}" for name, parts in (("paths", "RGB"), ("albedo", "RGB"), ("normal", "XYZ")) for part in parts
)


class Guides:
    """Albedo and normal along light paths, of mi.Color3f and mi.Vector3f, one for each ray of the camera."""

    def __init__(self, width: int):
        self.albedo: Any = dr.zeros(mi.Color3f, width)
        self.normal: Any = dr.zeros(mi.Vector3f, width)

    def add_light(self, light: Any, sample: Any, active: Any) -> None:
        """Of splats and emitters, mi.Spectrum."""
        add_to(self.albedo, _bounded(light), sample, active)

    def add_surface(self, si: Any, bsdf: Any, β: Any, sample: Any, active: Any) -> None:
        """Of surfaces, seen with the weight β."""
        albedo = β * dr.clip(bsdf.eval_diffuse_reflectance(si, active), 0, 1)
        add_to(self.albedo, _bounded(albedo), sample, active)
        n = si.sh_frame.n
        facing: Any = mi.Vector3f(dr.select(dr.dot(n, si.to_world(si.wi)) < 0, -n, n))
        add_to(self.normal, facing * mean_of(β), sample, active)

    def planes(self) -> list[mi.Float]:
        """Channels of albedo, then of normal."""
        return [*self.albedo, *self.normal]


def planes(T: Any, behind: list, guides: list) -> list[mi.Float]:
    """Constants, as ``CHANNELS`` has them: ``behind`` is what paths bring, seen through the transmittance T."""
    T = dr.detach(T)
    seen = dr.clip(T, 0, 1)
    return [T * dr.detach(light) for light in behind] + [seen * guide for guide in guides]


def nothing(width: int) -> list[mi.Float]:
    """Planes of a pass without paths."""
    return [dr.zeros(mi.Float, width) for _ in CHANNELS]


def _bounded(light: Any) -> Any:
    return mi.Color3f(*(dr.clip(channel, 0, 1) for channel in three_channels(light)))
