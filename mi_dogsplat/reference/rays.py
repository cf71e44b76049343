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


@dataclass
class _Kernels:
    """Either kernels of the primitives `index` [n], be it all."""

    index: np.ndarray | slice
    scales: np.ndarray  # [n, 3]
    opacities: np.ndarray  # [n]

    def values(self, o: np.ndarray, d: np.ndarray, left: np.ndarray) -> np.ndarray:
        """[P, n] on rays [P, N, 3] in the frames of the primitives, with what cuts leave [P, N], limited to .99."""
        largest, _ = _largest(o[:, self.index] / self.scales, d[:, self.index] / self.scales)
        return np.minimum(MAX_ALPHA, self.opacities * largest * left[:, self.index])

    def semi_axes(self, largest_left: np.ndarray, cutoff: float) -> np.ndarray:
        """[n, 3] of the ellipsoid in which they are above the cutoff, however much cuts leave of them, [N]."""
        return _radius(self.opacities * largest_left[self.index], cutoff)[:, None] * self.scales


def meet(splats: Splats, origins: np.ndarray, directions: np.ndarray, maxt: np.ndarray | float = np.inf, *,
         sh_degree: int | None = None, smooth: bool = False) -> RayMeetings:
    """All primitives on rays [P, 3] (directions of any length), between 0 and `maxt` [P]; `smooth`: no cutoffs."""
    cutoff = SMOOTH_ALPHA if smooth else MIN_ALPHA
    R, directions = rotations(np.asarray(splats.quats, np.float64)), np.asarray(directions, np.float64)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    away = np.asarray(origins, np.float64)[:, None] - seen_along(splats, unit)
    o = np.einsum("nij,pni->pnj", R, away)  # [P, N, 3] in the frames of the primitives
    d = np.einsum("nij,pi->pnj", R, directions)
    primary, pseudo = _both_kernels(splats)
    _, at = _largest(o / primary.scales, d / primary.scales)
    w = (o + at[..., None] * d) / primary.scales  # [P, N, 3]
    left, largest_left = _left_by_cuts(splats, w)

    alphas = primary.values(o, d, left)
    alphas[:, pseudo.index] -= pseudo.values(o, d, left)
    axes = primary.semi_axes(largest_left, cutoff)
    axes[pseudo.index] = np.maximum(axes[pseudo.index], pseudo.semi_axes(largest_left, cutoff))
    drawn = primary.opacities * largest_left > cutoff
    axes[~drawn] = 1
    _, places = _largest(o / axes, d / axes)
    inside = (places > 0) & (places < np.broadcast_to(maxt, len(alphas))[:, None]) & drawn
    alphas[~inside] = 0
    if not smooth:
        alphas[np.abs(alphas) < MIN_ALPHA] = 0
    return RayMeetings(places, alphas, _colors(splats, unit, w, sh_degree))


def _both_kernels(splats: Splats) -> tuple[_Kernels, _Kernels]:
    """Of all primitives the primary, of those that are DoG the pseudo-Gaussian."""
    scales = np.exp(np.asarray(splats.log_scales, np.float64))
    opacities = sigmoid(np.asarray(splats.logit_opacities, np.float64))
    i = np.asarray(splats.dog_index, np.int64)
    F = np.exp(np.asarray(splats.dog_log_scales, np.float64)).reshape(-1, 3)
    f_a = sigmoid(np.asarray(splats.dog_logit_opacities, np.float64))
    return _Kernels(slice(None), scales, opacities), _Kernels(i, F * scales[i], opacities[i] * f_a)


def _left_by_cuts(splats: Splats, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What cuts leave of kernels: (at the points w [P, N, 3] of their primitives, [P, N]; at most, [N])."""
    left, cut = np.ones(w.shape[:2]), np.zeros((len(PLANES), w.shape[1]), bool)
    for of_plane, plane in zip(cut, PLANES, strict=True):
        i = index_of(splats, plane)
        left[:, i] *= kept((w[:, i] * values_of(splats, plane)).sum(-1))
        of_plane[i] = True
    return left, largest_kept(cut)


def _colors(splats: Splats, unit: np.ndarray, w: np.ndarray, sh_degree: int | None) -> np.ndarray:
    """[P, N, 3] in the directions of the rays, at the points w [P, N, 3] of the primitives."""
    sh = padded_sh(splats)
    basis = sh_basis(unit, int(np.sqrt(sh.shape[1])) - 1 if sh_degree is None else sh_degree)
    colors = np.maximum(np.einsum("pk,nkc->pnc", basis, sh[:, : basis.shape[1]]) + 0.5, 0)
    i = index_of(splats, CURVATURES)
    Q = quadratic_forms(values_of(splats, CURVATURES))
    colors[:, i] += np.einsum("psa,sab,psb->ps", w[:, i], Q, w[:, i])[..., None] / 2
    i = index_of(splats, SLOPES)
    colors[:, i] += np.einsum("psa,sac->psc", w[:, i], values_of(splats, SLOPES))
    return colors


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
