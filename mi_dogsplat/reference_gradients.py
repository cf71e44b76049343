"""The float64 rasteriser for real models: image and analytic gradients, in NumPy alone, tile by tile.

`reference.py` is written for reading: it evaluates every primitive at every pixel and differentiates by differences,
two renders per parameter. Here 100,000 primitives at 400 x 300 pixels take seconds. `reference.project` is shared with
it, nothing is shared with the engine.

Notation of `reference.py`, and
    d            pixel centre minus means2d, q = d^T conic d, so that G = o exp(-q / 2)
    C = J W R    [N, 2, 3]: the axes of the primitive on the screen, before the scales: Sigma' = C S^2 C^T + .3 I
    δx           d loss / d x, loss = sum(adjoint * image)
    δlog G       summed over the pixels with 1, d and d d^T: the only three things that the shape of a kernel needs

Compositing. image = sum_i alpha_i T_i c_i + T_final background gives
    dC/dalpha_i = T_i c_i - (sum_{j > i} alpha_j T_j c_j + T_final background) / (1 - alpha_i)
The division is safe, 1 - alpha >= .01. The sum runs from the back: no difference of large numbers.

Shape. From d log G = d^T conic dSigma' conic d / 2 with D = sum δlog G d d^T and B = conic C:
    E = B^T D B,   δlog_scales_k = s_k^2 E_kk,   δω = (s_2^2 - s_3^2) E_23 and cyclic,   δJ = conic D B S^2 (W R)^T
where ω turns the primitive about its own axes, R exp([ω]). B is taken from cross products of the columns of C, which
do not cancel on needles as conic times C would.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .reference import (
    LOW_PASS,
    MAX_ALPHA,
    MAX_T,
    MIN_ALPHA,
    MIN_ANTIALIAS_RATIO,
    MIN_T,
    RAW_PARAMETERS,
    Projection,
    _sigmoid,
    depth_order,
    project,
    rotations,
    sh_basis,
)

if TYPE_CHECKING:
    from .cameras import Camera
    from .splats import Splats

TILE_SIZE = 16
MAX_PAIRS = 1 << 18  # primitives x pixels held at once; tiles with longer lists are halved
LEAST_KERNEL = 2.0**-60  # where the lists end when min_alpha does not end them
SLACK = 1e-6  # px, far above the rounding of a box and far below a pixel


@dataclass
class Rendered:
    """What `render_tiled` returns, float64."""

    image: np.ndarray  # [H, W, 3] over the background, not clamped
    T: np.ndarray  # [H, W] transmittance left for the background
    max_T: float  # largest transmittance met on the way, 1 without negative alphas


def render_tiled(splats: Splats, camera: Camera, background: Sequence[float] | np.ndarray = (0, 0, 0), *,
                 near_clip: float = 0.2, antialiased: bool = False, sh_degree: int | None = None,
                 negative_transmittance: bool = True, min_alpha: float = MIN_ALPHA,
                 min_transmittance: float = MIN_T) -> Rendered:
    """The image of `reference.render`, for models of any size.

    `min_alpha=0` ignores no primitive (kernels end at 2^-60), `min_transmittance=0` stops no walk: both together are
    its `smooth=True`. Raises ValueError if `sh_degree` exceeds what the primitives have.
    """
    projection = project(splats, camera, near_clip=near_clip, antialiased=antialiased, sh_degree=sh_degree)
    image, T, max_T = np.zeros((camera.height, camera.width, 3)), np.ones((camera.height, camera.width)), 1.0
    for block in _blocks(projection, camera, min_alpha):
        walk = _Walk(projection, block, negative_transmittance, min_alpha, min_transmittance)
        image[block.pixels] = np.tensordot(walk.alpha * walk.T, projection.colors[block.splats], (0, 0))
        T[block.pixels] = walk.T_final
        max_T = max(max_T, walk.T.max(), walk.T_final.max())
    return Rendered(image + T[..., None] * np.asarray(background, np.float64), T, float(max_T))


def gradients_tiled(splats: Splats, camera: Camera, adjoint: np.ndarray,
                    background: Sequence[float] | np.ndarray = (0, 0, 0), *, near_clip: float = 0.2,
                    antialiased: bool = False, sh_degree: int | None = None, negative_transmittance: bool = True,
                    min_alpha: float = MIN_ALPHA, min_transmittance: float = MIN_T) -> dict[str, np.ndarray]:
    """d sum(adjoint [H, W, 3] * image) / d raw parameter, by name and in the shapes of `splats`, float64.

    Options as in `render_tiled`. Derivatives through a cutoff are 0: of a primitive that was ignored or lies behind
    the end of the walk, of a kernel at its limit of .99, of a colour at its limit of 0. Raises ValueError if the
    shape of `adjoint` is not that of the image, or `sh_degree` exceeds what the primitives have.
    """
    adjoint = np.asarray(adjoint, np.float64)
    if adjoint.shape != (camera.height, camera.width, 3):
        raise ValueError(f"gradients_tiled: adjoint has the shape {adjoint.shape}, the image "
                         f"{(camera.height, camera.width, 3)}; both need to be equal")
    projection = project(splats, camera, near_clip=near_clip, antialiased=antialiased, sh_degree=sh_degree)
    n = len(projection.depths)
    δcolors, moments, pseudo_moments = np.zeros((n, 3)), np.zeros((n, 6)), np.zeros((n, 6))
    for block in _blocks(projection, camera, min_alpha):
        walk = _Walk(projection, block, negative_transmittance, min_alpha, min_transmittance)
        δpixels = adjoint[block.pixels]  # [h, w, 3]
        δcolors[block.splats] += np.tensordot(walk.alpha * walk.T, δpixels, ((1, 2), (0, 1)))
        δalpha = walk.backward(np.tensordot(projection.colors[block.splats], δpixels, (1, 2)), δpixels @ background)
        δlog_G = np.where(walk.G < MAX_ALPHA, δalpha * walk.G, 0)
        moments[block.splats] += _moments(δlog_G, block.dx, block.dy)
        if walk.dog.size:
            δlog_G = np.where(walk.G_p < MAX_ALPHA, -δalpha[walk.dog] * walk.G_p, 0)
            pseudo_moments[block.splats[walk.dog]] += _moments(δlog_G, block.dx[walk.dog], block.dy[walk.dog])
    return _projection_backward(splats, camera, projection, δcolors, moments, pseudo_moments, antialiased, sh_degree)


@dataclass
class _Block:
    pixels: tuple[slice, slice]  # rows, columns
    splats: np.ndarray  # [n] indices in depth order
    dx: np.ndarray  # [n, w] px
    dy: np.ndarray  # [n, h]


def _blocks(projection: Projection, camera: Camera, min_alpha: float) -> Iterator[_Block]:
    """Tiles, cut where their lists are long, with all primitives whose box {G or G_p >= min_alpha} meets them."""
    extents = np.full((len(projection.depths), 2), -np.inf)
    for opacities, cov2d in ((projection.opacities, projection.cov2d),
                             (projection.pseudo_opacities, projection.pseudo_cov2d)):
        ratio = opacities / (min_alpha or LEAST_KERNEL)
        half = np.sqrt(2 * np.log(np.maximum(ratio, 1))[:, None] * cov2d[:, [0, 2]]) + SLACK
        extents = np.maximum(extents, np.where(ratio[:, None] >= 1, half, -np.inf))
    order = depth_order(projection)
    centres = projection.means2d[order]
    low, high = centres - extents[order], centres + extents[order]
    boxes = [(x, y, min(x + TILE_SIZE, camera.width), min(y + TILE_SIZE, camera.height))
             for y in range(0, camera.height, TILE_SIZE) for x in range(0, camera.width, TILE_SIZE)]
    while boxes:
        x0, y0, x1, y1 = boxes.pop()
        meets = ((low[:, 0] <= x1 - 0.5) & (high[:, 0] >= x0 + 0.5) &
                 (low[:, 1] <= y1 - 0.5) & (high[:, 1] >= y0 + 0.5))
        found = np.flatnonzero(meets)
        if found.size * (x1 - x0) * (y1 - y0) > MAX_PAIRS and y1 - y0 > 1:
            middle = (y0 + y1) // 2
            boxes += [(x0, y0, x1, middle), (x0, middle, x1, y1)]
        elif found.size:
            dx = np.arange(x0, x1) + 0.5 - centres[found, :1]
            dy = np.arange(y0, y1) + 0.5 - centres[found, 1:]
            yield _Block((slice(y0, y1), slice(x0, x1)), order[found], dx, dy)


def _gaussian(opacities: np.ndarray, cov2d: np.ndarray, conics: np.ndarray, dx: np.ndarray,
              dy: np.ndarray) -> np.ndarray:
    """[n, h, w]. q as a sum of two squares, which keeps its precision on needles far from their centre."""
    sheared = dx[:, None, :] - ((cov2d[:, 1] / cov2d[:, 2])[:, None] * dy)[:, :, None]
    q = conics[:, 0, None, None] * sheared**2 + (dy**2 / cov2d[:, 2, None])[:, :, None]
    return opacities[:, None, None] * np.exp(-0.5 * q)


class _Walk:
    """One block's pixels, front to back; arrays are [n, h, w]."""

    def __init__(self, projection: Projection, block: _Block, negative_transmittance: bool, min_alpha: float,
                 min_transmittance: float):
        p, i = projection, block.splats
        self.G = _gaussian(p.opacities[i], p.cov2d[i], p.conics[i], block.dx, block.dy)
        alpha = np.minimum(MAX_ALPHA, self.G)
        self.dog = np.flatnonzero(p.dog[i])  # [m] rows of the block
        i = i[self.dog]
        self.G_p = _gaussian(p.pseudo_opacities[i], p.pseudo_cov2d[i], p.pseudo_conics[i],
                             block.dx[self.dog], block.dy[self.dog])  # [m, h, w]
        alpha[self.dog] -= np.minimum(MAX_ALPHA, self.G_p)
        self.blended = np.abs(alpha) >= min_alpha
        alpha[~self.blended] = 0
        self.attenuates = np.ones_like(self.blended) if negative_transmittance else alpha > 0
        with np.errstate(over="ignore"):  # beyond the end of the walk
            behind = np.cumprod(1 - np.where(self.attenuates, alpha, 0), axis=0)
        ended = np.logical_or.accumulate((behind < min_transmittance) | (behind > MAX_T), axis=0)
        if ended.any():
            alpha[ended] = 0
            self.blended &= ~ended
            behind = np.cumprod(1 - np.where(self.attenuates, alpha, 0), axis=0)
        self.alpha = alpha
        self.T = np.concatenate([np.ones_like(behind[:1]), behind[:-1]])  # in front of each primitive
        self.T_final = behind[-1]  # [h, w]

    def backward(self, δpixels_colors: np.ndarray, δpixels_background: np.ndarray) -> np.ndarray:
        """δalpha [n, h, w], from the adjoint of the pixels times each colour [n, h, w], and background [h, w]."""
        contributions = self.alpha * self.T * δpixels_colors
        from_back = np.concatenate([(self.T_final * δpixels_background)[None], contributions[:0:-1]])
        behind = np.cumsum(from_back, axis=0)[::-1]
        δalpha = self.T * δpixels_colors - np.where(self.attenuates, behind / (1 - self.alpha), 0)
        return np.where(self.blended, δalpha, 0)


def _moments(values: np.ndarray, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
    """Sums [n, 6] of values [n, h, w] times 1, dx, dy, dx^2, dx dy, dy^2."""
    by_x, by_y = values.sum(1), values.sum(2)  # [n, w], [n, h]
    times_dx = np.einsum("nhw,nw->nh", values, dx)
    return np.stack([by_y.sum(1), times_dx.sum(1), (by_y * dy).sum(1), (by_x * dx**2).sum(1),
                     (times_dx * dy).sum(1), (by_y * dy**2).sum(1)], axis=1)


def _symmetric(rows: np.ndarray) -> np.ndarray:
    return rows[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def _kernel_backward(C: np.ndarray, scales: np.ndarray, cov2d: np.ndarray, conics: np.ndarray, moments: np.ndarray,
                     antialiased: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """δmeans2d [n, 2], δlog_scales [n, 3], δω [n, 3] and δC [n, 2, 3] of one kernel per primitive."""
    variances, conic = scales**2, _symmetric(conics)
    det = (cov2d[:, 2] / conics[:, 0])[:, None, None]
    D = _symmetric(moments[:, 3:])
    turned = np.stack([-C[:, 1], C[:, 0]], axis=1)  # columns of C by 90 degrees
    if antialiased:
        # log of the factor: (log det(A A^T) - log det Sigma') / 2, again as a D
        det_raw = (np.cross(*(C * scales[:, None, :]).swapaxes(0, 1)) ** 2).sum(1)[:, None, None]
        free = det_raw > MIN_ANTIALIAS_RATIO * det
        inverse = (turned * variances[:, None, :]) @ turned.swapaxes(1, 2) / np.where(free, det_raw, 1)  # of A A^T
        D = D + np.where(free, moments[:, 0, None, None] * LOW_PASS * (np.eye(2) + LOW_PASS * inverse), 0)
    minors = C[:, 0, :, None] * C[:, 1, None, :] - C[:, 1, :, None] * C[:, 0, None, :]  # [n, j, k] = C_j x C_k
    B = (LOW_PASS * C + (turned * variances[:, None, :]) @ minors) / det  # conic C, [n, 2, 3]
    E = B.swapaxes(1, 2) @ D @ B
    δω = (np.roll(variances, -1, 1) - np.roll(variances, -2, 1)) * E[:, [1, 2, 0], [2, 0, 1]]
    δC = conic @ D @ B * variances[:, None, :]
    δmeans2d = np.einsum("nij,nj->ni", conic, moments[:, 1:3])
    return δmeans2d, variances * E[:, range(3), range(3)], δω, δC


def _colors_backward(means: np.ndarray, sh: np.ndarray, camera: Camera,
                     δcolors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """δmeans [n, 3] and δsh [n, K, 3] of colours that are not clamped: dirs = means - camera, normalised."""
    offsets = means - camera.position
    distances = np.linalg.norm(offsets, axis=1, keepdims=True)
    dirs, degree = offsets / distances, int(np.sqrt(sh.shape[1])) - 1
    δbasis = np.einsum("nkc,nc->nk", sh, δcolors)
    δdirs = np.empty_like(dirs)
    for axis, step in enumerate(0.5 * np.eye(3)):
        # The basis is a polynomial of degree 3 at most in the direction: five points give its derivative exactly.
        near, far = (sh_basis(dirs + k * step, degree) - sh_basis(dirs - k * step, degree) for k in (1, 2))
        δdirs[:, axis] = (δbasis * (8 * near - far) / 6).sum(1)
    δmeans = (δdirs - dirs * (dirs * δdirs).sum(1, keepdims=True)) / distances
    return δmeans, sh_basis(dirs, degree)[:, :, None] * δcolors[:, None, :]


def _projection_backward(splats: Splats, camera: Camera, projection: Projection, δcolors: np.ndarray,
                         moments: np.ndarray, pseudo_moments: np.ndarray, antialiased: bool,
                         sh_degree: int | None) -> dict[str, np.ndarray]:
    p, seen = projection, np.flatnonzero(projection.visible)  # [n]
    raw = {name: np.asarray(getattr(splats, name), np.float64) for name in RAW_PARAMETERS}
    δ = {name: np.zeros_like(values) for name, values in raw.items()}

    n_coeffs = raw["sh_coeffs"].shape[1] if sh_degree is None else (sh_degree + 1) ** 2
    δunclamped = np.where(p.colors[seen] > 0, δcolors[seen], 0)
    means, sh = raw["means"][seen], raw["sh_coeffs"][seen, :n_coeffs]
    δ["means"][seen], δ["sh_coeffs"][seen, :n_coeffs] = _colors_backward(means, sh, camera, δunclamped)

    # both rows of J W are focal / z (W_0 - slope W_2), with x / z or y / z for the slope
    W, focal, centre = camera.w2c[:3, :3], np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    position = means @ W.T + camera.w2c[:3, 3]
    z, size = position[:, 2:], np.array([camera.width, camera.height])
    slopes, low, high = position[:, :2] / z, -(centre + 0.15 * size) / focal, (1.15 * size - centre) / focal
    bases = W[:2] - np.clip(slopes, low, high)[:, :, None] * W[2]  # [n, 2, 3]
    R, scales = rotations(raw["quats"][seen]), np.exp(raw["log_scales"][seen])
    C = (focal / z)[:, :, None] * bases @ R
    δmeans2d, δlog_scales, δω, δC = _kernel_backward(C, scales, p.cov2d[seen], p.conics[seen], moments[seen],
                                                     antialiased)
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
    δ["dog_logit_opacities"][dog] = pseudo_moments[i, 0] * _sigmoid(-raw["dog_logit_opacities"][dog])
    δ["logit_opacities"][seen] = δlog_opacities[seen] * _sigmoid(-raw["logit_opacities"][seen])
    δ["log_scales"][seen] = δlog_scales

    # ω = 2 Im(conj(q) dq) / |q|^2, in the axes of the primitive
    length = np.linalg.norm(raw["quats"][seen], axis=1, keepdims=True)
    v, w = np.split(raw["quats"][seen] / np.where(length > 0, length, np.inf), [3], axis=1)
    δunit = 2 * np.concatenate([w * δω + np.cross(v, δω), -(v * δω).sum(1, keepdims=True)], axis=1)
    δ["quats"][seen] = δunit / np.where(length > 0, length, 1)

    δJW = δC @ R.swapaxes(1, 2)
    δfocal_by_z = (δJW * bases).sum(2)  # [n, 2]
    inside = (slopes > low) & (slopes < high)
    δslopes = focal * (δmeans2d - np.where(inside, δJW @ W[2], 0) / z)
    δz = -((δfocal_by_z * focal / z + δslopes * slopes) / z).sum(1, keepdims=True)
    δ["means"][seen] += np.concatenate([δslopes / z, δz], axis=1) @ W
    return δ
