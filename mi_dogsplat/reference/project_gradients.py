"""The derivative of `reference.project`: from kernels and colours back to raw parameters, in float64.

Notation of `forward.py`, and
    d            pixel centre minus means2d, q = d^T conic d, so that G = o exp(-q / 2)
    C = J W R    [N, 2, 3]: the axes of the primitive on the screen, before the scales: Sigma' = C S^2 C^T + .3 I
    δx           d loss / d x
    moments      δlog G summed over the pixels with 1, d and d d^T: all that a loss has to say about a kernel

From d log G = d^T conic dSigma' conic d / 2 with D = sum δlog G d d^T and B = conic C:
    E = B^T D B,   δlog_scales_k = s_k^2 E_kk,   δω = (s_2^2 - s_3^2) E_23 and cyclic,   δJ = conic D B S^2 (W R)^T
where ω turns the primitive about its own axes, R exp([ω]). What comes through slopes and cuts is in
`own_axes_gradients.py`, what comes through shifts in `shifts.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..scene.row_groups import CURVATURES, PLANES, SHIFTS, SLOPES
from .directions import directions
from .forward import RAW_PARAMETERS
from .linearised import Linearised
from .mixed_sh import padded_sh, unpadded_sh
from .own_axes import index_of, values_of
from .own_axes_gradients import curvatures_backward, cuts_backward, own_axes_backward
from .projection import (
    LOW_PASS,
    MIN_ANTIALIAS_RATIO,
    Projection,
    conics_times_axes,
    determinants,
    sh_basis,
    sigmoid,
    symmetric,
    turned_columns,
)
from .quaternions import quats_backward, rotations
from .shifts import seen_from, shifts_backward

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats


@dataclass
class ScreenAdjoints:
    """All that a loss has to say about the N primitives of a projection, float64."""

    colors: np.ndarray  # [N, 3] at the centres
    color_slopes: np.ndarray  # [N, 3, 2] by `Projection.slopes`
    curvatures: np.ndarray  # [N, 2, 2] by `Projection.curvatures`
    moments: np.ndarray  # [N, 6] sums of δlog G times 1, dx, dy, dx^2, dx dy, dy^2
    pseudo_moments: np.ndarray  # [N, 6] of δlog G_p
    cut_moments: np.ndarray  # [2, N, 3] sums of δ(n.w) of each plane times 1, dx, dy

    @staticmethod
    def zeros(n: int) -> ScreenAdjoints:
        shapes = (n, 3), (n, 3, 2), (n, 2, 2), (n, 6), (n, 6), (len(PLANES), n, 3)
        return ScreenAdjoints(*(np.zeros(shape) for shape in shapes))


def project_backward(splats: Splats, camera: Camera, projection: Projection, screen: ScreenAdjoints,
                     antialiased: bool, sh_degree: int | None) -> dict[str, np.ndarray]:
    """d loss / d raw parameter, by name and in the shapes of `splats`, float64.

    `projection` is what `reference.project` makes of `splats` and `camera` with the same options. The derivative is 0
    through the limits: of a primitive that is not visible, of a colour at 0, of a clamped tangent.
    """
    p, seen = projection, np.flatnonzero(projection.visible)  # [n]
    raw = {name: np.asarray(getattr(splats, name), np.float64) for name in RAW_PARAMETERS}
    raw["sh_coeffs"] = padded_sh(splats)
    δ = {name: np.zeros_like(values) for name, values in raw.items()}

    n_coeffs = raw["sh_coeffs"].shape[1] if sh_degree is None else (sh_degree + 1) ** 2
    δunclamped = np.where(p.colors[seen] > 0, screen.colors[seen], 0)
    means, sh = raw["means"][seen], raw["sh_coeffs"][seen, :n_coeffs]
    δ["means"][seen], δ["sh_coeffs"][seen, :n_coeffs] = _colors_backward(means, sh, camera, δunclamped)

    R, linear = rotations(raw["quats"][seen]), Linearised(camera, seen_from(splats, camera)[seen])
    axes = _Axes(seen, linear.JW @ R, np.exp(raw["log_scales"][seen]))
    δmeans2d, _ = axes.add_kernel(seen, 1.0, p.cov2d, p.conics, screen.moments, antialiased)
    # what a pixel has of a colour that varies, and of a cut, depends on where the centre is
    δmeans2d -= np.einsum("ncd,nc->nd", p.slopes[seen], screen.colors[seen])
    δmeans2d -= np.einsum("nij,nj->ni", p.curvatures[seen], screen.color_slopes[seen].sum(1))
    δmeans2d -= (p.cuts[:, seen] * screen.cut_moments[:, seen, :1]).sum(0)

    dog_index = np.asarray(splats.dog_index, np.int64)
    dog = np.flatnonzero(p.visible[dog_index])  # [m] rows of the DoG parameters
    i, F = dog_index[dog], np.exp(raw["dog_log_scales"][dog])
    δcentres2d, δ["dog_log_scales"][dog] = axes.add_kernel(i, F, p.pseudo_cov2d, p.pseudo_conics,
                                                           screen.pseudo_moments, antialiased)
    δmeans2d[axes.rows(i)] += δcentres2d
    δlog_opacities = screen.moments[:, 0] + screen.pseudo_moments[:, 0]
    δ["logit_opacities"][seen] = δlog_opacities[seen] * sigmoid(-raw["logit_opacities"][seen])
    δ["dog_logit_opacities"][dog] = screen.pseudo_moments[i, 0] * sigmoid(-raw["dog_logit_opacities"][dog])

    δ |= _own_axes_backward(splats, p, screen, axes)
    δcentres = linear.backward(δmeans2d, axes.δC @ R.swapaxes(1, 2))
    δ["means"][seen] += δcentres
    δ |= _shifts_backward(splats, camera, p, δcentres, axes, δ["means"])
    δ["log_scales"][seen] = axes.δlog_scales
    δ["quats"][seen] = quats_backward(raw["quats"][seen], axes.δω)
    return δ | unpadded_sh(δ["sh_coeffs"], splats)


class _Axes:
    """C [n, 2, 3] and the scales [n, 3] of the primitives `seen` [n], and adjoints to which all adds that has them."""

    def __init__(self, seen: np.ndarray, C: np.ndarray, scales: np.ndarray):
        self.seen, self.C, self.scales = seen, C, scales
        self.δlog_scales, self.δω, self.δC = np.zeros_like(scales), np.zeros_like(scales), np.zeros_like(C)

    def rows(self, i: np.ndarray) -> np.ndarray:
        """Where the primitives i [m] are among those that are seen."""
        return np.searchsorted(self.seen, i)

    def add(self, i: np.ndarray, δlog_scales: np.ndarray, δω: np.ndarray, δC: np.ndarray | float = 0.0) -> None:
        """Of the primitives i [m]."""
        at = self.rows(i)
        for whole, part in zip((self.δlog_scales, self.δω, self.δC), (δlog_scales, δω, δC), strict=True):
            whole[at] += part

    def add_kernel(self, i: np.ndarray, F: np.ndarray | float, cov2d: np.ndarray, conics: np.ndarray,
                   moments: np.ndarray, antialiased: bool) -> tuple[np.ndarray, np.ndarray]:
        """Of kernels of the primitives i [m], `F` times as large as these; returns δmeans2d [m, 2], δlog F [m, 3]."""
        at = self.rows(i)
        δmeans2d, *parts = _kernel_backward(self.C[at], self.scales[at] * F, cov2d[i], conics[i], moments[i],
                                            antialiased)
        self.add(i, *parts)
        return δmeans2d, parts[0]


def _own_axes_backward(splats: Splats, p: Projection, screen: ScreenAdjoints, axes: _Axes) -> dict[str, np.ndarray]:
    """δ of what primitives have along their axes, slopes, curvatures and cuts, by name; adds to `axes`."""
    of_kinds = [(SLOPES, screen.color_slopes, own_axes_backward), (CURVATURES, screen.curvatures, curvatures_backward)]
    of_kinds += [(plane, δh, cuts_backward) for plane, δh in zip(PLANES, screen.cut_moments[:, :, 1:], strict=True)]
    δ = {}
    for group, δper_pixel, backward in of_kinds:
        index, values = index_of(splats, group), values_of(splats, group)
        if len(index):
            found = np.flatnonzero(p.visible[index])  # rows of the group
            i = index[found]
            at = axes.rows(i)
            δvalues, *parts = backward(axes.C[at], axes.scales[at], p.cov2d[i], p.conics[i], values[found],
                                       δper_pixel[i])
            axes.add(i, *parts)
            (name,) = group.names
            δ[name] = np.zeros_like(values)
            δ[name][found] = δvalues
    return δ


def _shifts_backward(splats: Splats, camera: Camera, p: Projection, δcentres: np.ndarray, axes: _Axes,
                     δmeans: np.ndarray) -> dict[str, np.ndarray]:
    """δ of the shifts, by name, from that of where centres are seen [n, 3]; adds to `axes` and to `δmeans` [N, 3]."""
    index = index_of(splats, SHIFTS)
    if not len(index):
        return {}
    found = np.flatnonzero(p.visible[index])  # rows of the group
    i = index[found]
    δstored, *parts, of_shifts = shifts_backward(splats, camera, found, δcentres[axes.rows(i)])
    δmeans[i] += δstored
    axes.add(i, *parts)
    return of_shifts


def _kernel_backward(C: np.ndarray, scales: np.ndarray, cov2d: np.ndarray, conics: np.ndarray, moments: np.ndarray,
                     antialiased: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """δmeans2d [n, 2], δlog_scales [n, 3], δω [n, 3] and δC [n, 2, 3] of one kernel per primitive."""
    variances, conic = scales**2, symmetric(conics)
    D = symmetric(moments[:, 3:])
    if antialiased:
        # log of the factor: (log det(A A^T) - log det Sigma') / 2, again as a D
        turned = turned_columns(C)
        det_raw = (np.cross(*(C * scales[:, None, :]).swapaxes(0, 1)) ** 2).sum(1)[:, None, None]
        free = det_raw > MIN_ANTIALIAS_RATIO * determinants(cov2d, conics)
        inverse = (turned * variances[:, None, :]) @ turned.swapaxes(1, 2) / np.where(free, det_raw, 1)  # of A A^T
        D = D + np.where(free, moments[:, 0, None, None] * LOW_PASS * (np.eye(2) + LOW_PASS * inverse), 0)
    B = conics_times_axes(C, variances, cov2d, conics)  # [n, 2, 3]
    E = B.swapaxes(1, 2) @ D @ B
    δω = (np.roll(variances, -1, 1) - np.roll(variances, -2, 1)) * E[:, [1, 2, 0], [2, 0, 1]]
    δC = conic @ D @ B * variances[:, None, :]
    δmeans2d = np.einsum("nij,nj->ni", conic, moments[:, 1:3])
    return δmeans2d, variances * E[:, range(3), range(3)], δω, δC


def _colors_backward(means: np.ndarray, sh: np.ndarray, camera: Camera,
                     δcolors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """δmeans [n, 3] and δsh [n, K, 3] of colours that are not clamped: dirs = means - camera, normalised."""
    dirs, distances = directions(means - camera.position)
    degree = int(np.sqrt(sh.shape[1])) - 1
    δbasis = np.einsum("nkc,nc->nk", sh, δcolors)
    δdirs = np.empty_like(dirs)
    for axis, step in enumerate(0.5 * np.eye(3)):
        # The basis is a polynomial of degree 3 at most in the direction: five points give its derivative exactly.
        near, far = (sh_basis(dirs + k * step, degree) - sh_basis(dirs - k * step, degree) for k in (1, 2))
        δdirs[:, axis] = (δbasis * (8 * near - far) / 6).sum(1)
    δmeans = (δdirs - dirs * (dirs * δdirs).sum(1, keepdims=True)) / distances
    return δmeans, sh_basis(dirs, degree)[:, :, None] * δcolors[:, None, :]
