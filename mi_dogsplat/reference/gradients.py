"""The float64 rasteriser for real models: image and analytic gradients, in NumPy alone, tile by tile.

`forward.py` is written for reading: it evaluates every primitive at every pixel and differentiates by differences,
two renders per parameter. Here 100,000 primitives at 400 x 300 pixels take seconds. `reference.project` is shared with
it, nothing is shared with the engine.

Notation of `forward.py`, and
    d            pixel centre minus means2d, q = d^T conic d, so that G = o exp(-q / 2)
    δx           d loss / d x, loss = sum(adjoint * image)
    moments      δlog G summed over the pixels with 1, d and d d^T: all that the projection needs of it

image = sum_i alpha_i T_i c_i + T_final background gives
    dC/dalpha_i = T_i c_i - (sum_{j > i} alpha_j T_j c_j + T_final background) / (1 - alpha_i)
The division is safe, 1 - alpha >= .01. The sum runs from the back: no difference of large numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .forward import MAX_ALPHA, MAX_T, MIN_ALPHA, MIN_T, Projection, depth_order, project
from .project_gradients import project_backward

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats

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
    return project_backward(splats, camera, projection, δcolors, moments, pseudo_moments, antialiased, sh_degree)


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
