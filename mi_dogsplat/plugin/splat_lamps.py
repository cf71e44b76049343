"""Captured lamps: the few primitives that are much brighter than white, as emitters that paths aim at.

Notation
    P_k         probability with which lamp k is chosen at a vertex: its power over the square of its distance
    p(ω)        density of directions: uniform within the cone around the lamp that is chosen, Σ P_k p_k(ω)

Whatever the segment in a direction gathers counts, not the light of the lamp that was chosen only. So the density need
not fit it well: what it misses is found by BSDF sampling, with which it is combined.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.rows import rows
from ..scene.curvatures import mean_brightness
from ..scene.row_groups import CURVATURES
from ..scene.sh_basis import C0
from .transfer import srgb_to_linear

BRIGHT = 20.0  # radiance: of trained models some primitives reach 14, with light that others take away again
MOST = 8  # lamps: each costs a little at every vertex
CONE = 2.5  # radius of what a cone encloses, in scales of the lamp
NARROWEST = 0.03  # sine of a cone's half angle, so that its solid angle has digits in float32


@dataclass
class SplatLamps:
    """Some primitives as balls."""

    center: list  # of mi.Point3f
    radius: list  # of mi.Float
    power: list  # of mi.Float, relative to each other

    def sample(self, p: Any, which: Any, place: Any) -> tuple[Any, Any]:
        """(ω, p(ω)) at points, by random numbers of one and of two dimensions."""
        axis, rim, total = dr.zeros(mi.Vector3f, dr.width(p)), mi.Float(0), mi.Float(0)
        cones = self._cones(p)
        for k, (axis_k, rim_k, P) in enumerate(cones):
            chosen = (which >= total) | (k == 0)
            axis, rim, total = dr.select(chosen, axis_k, axis), dr.select(chosen, rim_k, rim), total + P
        height = 1 - place.x * rim
        r, φ = dr.safe_sqrt(1 - height * height), dr.two_pi * place.y
        local = mi.Vector3f(r * dr.cos(φ), r * dr.sin(φ), height)
        d = mi.Frame3f(axis).to_world(local)
        return d, _density(cones, d)

    def pdf(self, p: Any, d: Any) -> Any:
        """p(ω) of directions at points."""
        return _density(self._cones(p), d)

    def _cones(self, p: Any) -> list:
        """Of each lamp: unit vector to it, 1 - cosine of the cone's half angle, P; the whole sphere within a lamp."""
        cones, sum_ = [], mi.Float(0)
        for center, radius, power in zip(self.center, self.radius, self.power, strict=True):
            to = center - p
            d2 = dr.maximum(dr.squared_norm(to), 1e-12)
            sin2 = dr.maximum(radius * radius / d2, NARROWEST**2)
            rim = dr.select(sin2 < 1, sin2 / (1 + dr.safe_sqrt(1 - sin2)), 2)
            weight = power / dr.maximum(d2, radius * radius)
            cones.append((to * dr.rsqrt(d2), rim, weight))
            sum_ += weight
        return [(axis, rim, weight / sum_) for axis, rim, weight in cones]


def _density(cones: list, d: Any) -> Any:
    found = mi.Float(0)
    for axis, rim, P in cones:
        found += dr.select(1 - dr.dot(axis, d) <= rim, P / (dr.two_pi * rim), 0)
    return found


def lamps_of(params: dict, linear: bool) -> SplatLamps | None:
    """The lamps among primitives, by their colour without the directions; None where nothing is bright enough.

    A colour that varies over its primitive counts with its mean. Of slopes that is the colour of the centre: what they
    add on one side they take on the other. Curvatures make it brighter than that, or darker (``mean_brightness``). A
    primitive that is cut off counts as whole, and one whose place depends on the view stands where it is stored. Where
    paths aim changes no mean, and what they find there varies, is cut off and stands elsewhere as it is.

    Args:
        params: raw parameters as flat arrays; constants here.
        linear: colours are linear, not sRGB.
    """
    with dr.suspend_grad():
        if dr.width(params["logit_opacities"]) == 0:
            return None
        brightest = _brightest(params, linear)
        lamps: Any = dr.compress(brightest > BRIGHT)
        if not dr.width(lamps):
            return None
        means, scales = (np.array(rows(params[name], 3, lamps)).T for name in ("means", "log_scales"))
        power = _power(params, lamps, scales, brightest)
    best = np.argsort(-power, kind="stable")[:MOST]
    best = best[(power[best] > 0) & np.isfinite(means[best]).all(1)]
    if not len(best):
        return None
    center = [mi.Point3f(*(dr.opaque(mi.Float, float(x)) for x in means[k])) for k in best]
    radius = [dr.opaque(mi.Float, CONE * float(np.exp(scales[k].max()))) for k in best]
    return SplatLamps(center, radius, [dr.opaque(mi.Float, float(power[k])) for k in best])


def _brightest(params: dict, linear: bool) -> Any:
    """[N] linear radiance in the brightest channel."""
    n = dr.width(params["logit_opacities"])
    stored, index = dr.width(params["sh_coeffs"]) // n, dr.arange(mi.UInt32, n)
    colors = [0.5 + C0 * dr.gather(mi.Float, params["sh_coeffs"], index * stored + c) for c in range(3)]
    brightest = dr.maximum(dr.maximum(colors[0], colors[1]), colors[2]) + _brighter(params)
    return brightest if linear else srgb_to_linear([brightest])[0]


def _power(params: dict, lamps: Any, scales: np.ndarray, brightest: Any) -> np.ndarray:
    """[L] of lamps: radiance times opacity times the area that the two longest axes span."""
    opacities = dr.rcp(1 + dr.exp(-dr.gather(mi.Float, params["logit_opacities"], lamps))).numpy()
    radiance = dr.gather(mi.Float, brightest, lamps).numpy()
    with np.errstate(over="ignore", invalid="ignore"):  # of scales beyond all numbers, which a broken training leaves
        area = np.exp(np.sort(scales, 1)[:, 1:].sum(1))
        return np.nan_to_num(radiance * opacities * area, posinf=0)


def _brighter(params: dict) -> Any:
    """[N] by how much curvatures make primitives brighter on average, all channels of them."""
    if CURVATURES.index not in params:
        return 0
    (name,), index = CURVATURES.names, params[CURVATURES.index].numpy()
    brighter = np.zeros(dr.width(params["logit_opacities"]), np.float32)
    log_scales = params["log_scales"].numpy().reshape(-1, 3)[index]
    brighter[index] = mean_brightness(params[name].numpy().reshape(len(index), -1), log_scales)
    return mi.Float(brighter)
