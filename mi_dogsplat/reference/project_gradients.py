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

from typing import TYPE_CHECKING

import numpy as np

from ..scene.row_groups import CURVATURES, PLANES, SHIFTS, SLOPES
from .directions import directions
from .forward import RAW_PARAMETERS
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


def project_backward(splats: Splats, camera: Camera, projection: Projection, δcolors: np.ndarray,
                     δcolor_slopes: np.ndarray, δcurvatures: np.ndarray, moments: np.ndarray,
                     pseudo_moments: np.ndarray, cut_moments: np.ndarray, antialiased: bool,
                     sh_degree: int | None) -> dict[str, np.ndarray]:
    """d loss / d raw parameter, by name and in the shapes of `splats`, float64.

    `projection` is what `reference.project` makes of `splats` and `camera` with the same options. `δcolors` [N, 3],
    `δcolor_slopes` [N, 3, 2] and `δcurvatures` [N, 2, 2] are by what that has of them; `moments` and `pseudo_moments`
    [N, 6] are the sums of δlog G and δlog G_p times 1, dx, dy, dx^2, dx dy, dy^2, `cut_moments` [2, N, 3] those of
    δ(n.w) of each plane times 1, dx, dy. The derivative is 0 through the limits: of a primitive that is not visible, of
    a colour at 0, of a clamped tangent.
    """
    p, seen = projection, np.flatnonzero(projection.visible)  # [n]
    raw = {name: np.asarray(getattr(splats, name), np.float64) for name in RAW_PARAMETERS}
    raw["sh_coeffs"] = padded_sh(splats)
    δ = {name: np.zeros_like(values) for name, values in raw.items()}

    n_coeffs = raw["sh_coeffs"].shape[1] if sh_degree is None else (sh_degree + 1) ** 2
    δunclamped = np.where(p.colors[seen] > 0, δcolors[seen], 0)
    means, sh = raw["means"][seen], raw["sh_coeffs"][seen, :n_coeffs]
    δ["means"][seen], δ["sh_coeffs"][seen, :n_coeffs] = _colors_backward(means, sh, camera, δunclamped)

    # both rows of J W are focal / z (W_0 - tangent W_2), with x / z or y / z for the tangent
    W, focal, centre = camera.w2c[:3, :3], np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    position = seen_from(splats, camera)[seen] @ W.T + camera.w2c[:3, 3]
    z, size = position[:, 2:], np.array([camera.width, camera.height])
    tangents, low, high = position[:, :2] / z, -(centre + 0.15 * size) / focal, (1.15 * size - centre) / focal
    bases = W[:2] - np.clip(tangents, low, high)[:, :, None] * W[2]  # [n, 2, 3]
    R, scales = rotations(raw["quats"][seen]), np.exp(raw["log_scales"][seen])
    C = (focal / z)[:, :, None] * bases @ R
    δmeans2d, δlog_scales, δω, δC = _kernel_backward(C, scales, p.cov2d[seen], p.conics[seen], moments[seen],
                                                     antialiased)
    # what a pixel has of a colour that varies, and of a cut, depends on where the centre is
    δmeans2d -= np.einsum("ncd,nc->nd", p.slopes[seen], δcolors[seen])
    δmeans2d -= np.einsum("nij,nj->ni", p.curvatures[seen], δcolor_slopes[seen].sum(1))
    δmeans2d -= (p.cuts[:, seen] * cut_moments[:, seen, :1]).sum(0)
    δlog_opacities = moments[:, 0].copy()

    dog_index = np.asarray(splats.dog_index, np.int64)
    dog = np.flatnonzero(p.visible[dog_index])  # [m] rows of the DoG parameters
    i = dog_index[dog]
    at = np.searchsorted(seen, i)
    parts = _kernel_backward(C[at], scales[at] * np.exp(raw["dog_log_scales"][dog]), p.pseudo_cov2d[i],
                             p.pseudo_conics[i], pseudo_moments[i], antialiased)
    δ["dog_log_scales"][dog] = parts[1]
    for whole, part in zip((δmeans2d, δlog_scales, δω, δC), parts, strict=True):
        whole[at] += part
    δlog_opacities += pseudo_moments[:, 0]
    δ["dog_logit_opacities"][dog] = pseudo_moments[i, 0] * sigmoid(-raw["dog_logit_opacities"][dog])
    δ["logit_opacities"][seen] = δlog_opacities[seen] * sigmoid(-raw["logit_opacities"][seen])

    of_kinds = [(SLOPES, δcolor_slopes, own_axes_backward), (CURVATURES, δcurvatures, curvatures_backward)]
    of_kinds += [(plane, δcuts, cuts_backward) for plane, δcuts in zip(PLANES, cut_moments[:, :, 1:], strict=True)]
    for group, δper_pixel, backward in of_kinds:
        index, values = index_of(splats, group), values_of(splats, group)
        if not len(index):
            continue
        found = np.flatnonzero(p.visible[index])  # rows of the group
        i = index[found]
        at = np.searchsorted(seen, i)
        δvalues, *parts = backward(C[at], scales[at], p.cov2d[i], p.conics[i], values[found], δper_pixel[i])
        (name,) = group.names
        δ[name] = np.zeros_like(values)
        δ[name][found] = δvalues
        for whole, part in zip((δlog_scales, δω, δC), parts, strict=True):
            whole[at] += part

    δJW = δC @ R.swapaxes(1, 2)
    δfocal_by_z = (δJW * bases).sum(2)  # [n, 2]
    inside = (tangents > low) & (tangents < high)
    δtangents = focal * (δmeans2d - np.where(inside, δJW @ W[2], 0) / z)
    δz = -((δfocal_by_z * focal / z + δtangents * tangents) / z).sum(1, keepdims=True)
    δcentres = np.concatenate([δtangents / z, δz], axis=1) @ W
    δ["means"][seen] += δcentres

    index = index_of(splats, SHIFTS)
    if len(index):
        found = np.flatnonzero(p.visible[index])  # rows of the group
        at = np.searchsorted(seen, index[found])
        δmeans, *parts, of_shifts = shifts_backward(splats, camera, found, δcentres[at])
        δ["means"][index[found]] += δmeans
        for whole, part in zip((δlog_scales, δω), parts, strict=True):
            whole[at] += part
        δ |= of_shifts
    δ["log_scales"][seen] = δlog_scales
    δ["quats"][seen] = quats_backward(raw["quats"][seen], δω)
    return δ | unpadded_sh(δ["sh_coeffs"], splats)


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
