"""Primitives along arbitrary rays, in plain float64 NumPy: every primitive against every ray, no tree.

A kernel counts with its largest value on the ray (3DGRT, Moenne-Loccoz et al. 2024). A primitive has one place on the
ray: where that comes nearest to the centre, measured by the primitive's cutoff ellipsoid. The semi-axes of this are the
larger ones of r s and r_p F s, r and r_p being the radii, in standard deviations, at which the two kernels fall to
1/255. For a Gaussian it is the point of the largest value.

A colour that varies over its primitive is that of the point where the primary is largest: w there, in standard
deviations, is what the primary expects of a point of the ray. So is what cuts leave of both kernels. The radii of a
primitive that is cut off are those of its kernels as large as cuts may make them, each 1 + e^-4 times as opaque.

A primitive whose place depends on the view stands where it does along the direction of the ray.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..scene.row_groups import CURVATURES, PLANES, SLOPES
from .forward import MAX_ALPHA, MAX_T, MIN_T
from .mixed_sh import padded_sh
from .own_axes import index_of, kept, largest_kept, quadratic_forms, values_of
from .projection import MIN_ALPHA, sh_basis, sigmoid
from .quaternions import rotations
from .shifts import seen_along

if TYPE_CHECKING:
    from ..scene.splats import Splats

SMOOTH_ALPHA = 2.0**-60  # what takes the place of 1/255 without cutoffs


@dataclass
class RayMeetings:
    """P rays and N primitives."""

    places: np.ndarray  # [P, N] in units of the directions
    alphas: np.ndarray  # [P, N], 0 outside of the segment and below the cutoff
    colors: np.ndarray  # [P, N, 3] in the direction of the ray, and at its point


def meet(splats: Splats, origins: np.ndarray, directions: np.ndarray, maxt: np.ndarray | float = np.inf, *,
         sh_degree: int | None = None, smooth: bool = False) -> RayMeetings:
    """All primitives on rays [P, 3] (directions of any length), between 0 and `maxt` [P]; `smooth`: no cutoffs."""
    cutoff = SMOOTH_ALPHA if smooth else MIN_ALPHA
    scales = np.exp(np.asarray(splats.log_scales, np.float64))  # [N, 3]
    opacities = sigmoid(np.asarray(splats.logit_opacities, np.float64))
    R = rotations(np.asarray(splats.quats, np.float64))
    directions = np.asarray(directions, np.float64)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    away = np.asarray(origins, np.float64)[:, None] - seen_along(splats, unit)
    o = np.einsum("nij,pni->pnj", R, away)  # [P, N, 3] in the frames of the primitives
    d = np.einsum("nij,pi->pnj", R, directions)

    largest, at = _largest(o / scales, d / scales)
    w = (o + at[..., None] * d) / scales  # [P, N, 3]
    left, cut = np.ones(largest.shape), np.zeros((len(PLANES), len(scales)), bool)
    for of_plane, plane in zip(cut, PLANES, strict=True):
        i = index_of(splats, plane)
        left[:, i] *= kept((w[:, i] * values_of(splats, plane)).sum(-1))
        of_plane[i] = True

    alphas = np.minimum(MAX_ALPHA, opacities * largest * left)
    at_most = opacities * largest_kept(cut)
    axes = _radius(at_most, cutoff)[:, None] * scales
    i = np.asarray(splats.dog_index, np.int64)
    if len(i):
        factors = np.exp(np.asarray(splats.dog_log_scales, np.float64)) * scales[i]
        pseudo = opacities[i] * sigmoid(np.asarray(splats.dog_logit_opacities, np.float64))
        of_pseudo = pseudo * _largest(o[:, i] / factors, d[:, i] / factors)[0]
        alphas[:, i] -= np.minimum(MAX_ALPHA, of_pseudo * left[:, i])
        axes[i] = np.maximum(axes[i], _radius(pseudo * largest_kept(cut[:, i]), cutoff)[:, None] * factors)
    axes[at_most <= cutoff] = 1  # not drawn
    places = _largest(o / axes, d / axes)[1]
    inside = (places > 0) & (places < np.broadcast_to(maxt, len(alphas))[:, None]) & (at_most > cutoff)
    alphas[~inside] = 0
    if not smooth:
        alphas[np.abs(alphas) < MIN_ALPHA] = 0

    sh = padded_sh(splats)
    basis = sh_basis(unit, int(np.sqrt(sh.shape[1])) - 1 if sh_degree is None else sh_degree)
    colors = np.maximum(np.einsum("pk,nkc->pnc", basis, sh[:, : basis.shape[1]]) + 0.5, 0)
    i = index_of(splats, CURVATURES)
    Q = quadratic_forms(values_of(splats, CURVATURES))
    colors[:, i] += np.einsum("psa,sab,psb->ps", w[:, i], Q, w[:, i])[..., None] / 2
    i = index_of(splats, SLOPES)
    colors[:, i] += np.einsum("psa,sac->psc", w[:, i], values_of(splats, SLOPES))
    return RayMeetings(places, alphas, colors)


def _radius(opacities: np.ndarray, cutoff: float) -> np.ndarray:
    """Standard deviations at which a kernel falls to the cutoff; 0 where it is nowhere above."""
    return np.sqrt(2 * np.log(np.maximum(opacities / cutoff, 1)))


def _largest(o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(largest value of exp(-|x|^2 / 2) on the lines o + t d, its t) over the last axis."""
    t = -(o * d).sum(-1) / (d * d).sum(-1)
    x = o + t[..., None] * d
    return np.exp(-0.5 * (x * x).sum(-1)), t


def transmittance(meetings: RayMeetings, *, negative_transmittance: bool = True, smooth: bool = False) -> np.ndarray:
    """[P] product of 1 - alpha; 0 where it is below 1e-4."""
    hidden = meetings.alphas if negative_transmittance else np.maximum(meetings.alphas, 0)
    T = np.prod(1 - hidden, axis=1)
    return T if smooth else np.where(T >= MIN_T, T, 0)


def gather(meetings: RayMeetings, *, negative_transmittance: bool = True,
           smooth: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """(colours [P, 3], transmittance [P]) front to back; stops before T falls below 1e-4."""
    order = np.argsort(np.where(meetings.alphas != 0, meetings.places, np.inf), axis=1, kind="stable")
    colors, T = np.zeros((len(order), 3)), np.ones(len(order))
    rows, walking = np.arange(len(order)), np.ones(len(order), bool)
    for k in range(order.shape[1]):
        i = order[:, k]
        alpha = meetings.alphas[rows, i]
        T_next = T * (1 - (alpha if negative_transmittance else np.maximum(alpha, 0)))
        walking &= T_next <= MAX_T
        if not smooth:
            walking &= T_next >= MIN_T
        colors += np.where(walking, alpha * T, 0)[:, None] * meetings.colors[rows, i]
        T = np.where(walking, T_next, T)
    return colors, T
