"""One block of pixels and the primitives that meet it, in float64: what the twins of real models blend.

Notation of `forward.py`, and
    d            pixel centre minus means2d, q = d^T conic d, so that G = o exp(-q / 2) g, g of all planes, 1 without

`reference.project` is shared with `forward.py`, nothing is shared with the engine.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..scene.cuts import OFFSET
from .forward import MAX_ALPHA, MAX_T, depth_order, tile_boxes
from .own_axes import kept, largest_kept, log_kept_slope
from .projection import Projection

if TYPE_CHECKING:
    from ..scene.cameras import Camera

TILE_SIZE = 16
MAX_PAIRS = 1 << 18  # primitives x pixels held at once; tiles with longer lists are halved
LEAST_KERNEL = 2.0**-60  # where the lists end when min_alpha does not end them
SLACK = 1e-6  # px, far above the rounding of a box and far below a pixel
UNIT = 2.0**-24  # the largest relative error of a float32 operation
KERNEL_UNITS = 16  # of one kernel's value: the engine has up to 15 on needles, 9 elsewhere
COLOR_UNITS = 8  # of a colour that varies: of what it changes by per pixel, and of the sum
MEAN_UNITS = 4  # of many kernels, whose errors are of either sign: the engine has up to 3.4 in stacks of hundreds


@dataclass
class Block:
    """A tile, or a part of one, and what meets it."""

    pixels: tuple[slice, slice]  # rows, columns
    splats: np.ndarray  # [n] indices in depth order
    dx: np.ndarray  # [n, w] px
    dy: np.ndarray  # [n, h]


def blocks(projection: Projection, camera: Camera, min_alpha: float) -> Iterator[Block]:
    """Tiles, cut where their lists are long, with all primitives whose box {G or G_p >= min_alpha} meets them."""
    extents, largest = np.full((len(projection.depths), 2), -np.inf), largest_kept(projection.cut)
    for opacities, cov2d in ((projection.opacities, projection.cov2d),
                             (projection.pseudo_opacities, projection.pseudo_cov2d)):
        ratio = largest * opacities / (min_alpha or LEAST_KERNEL)
        half = np.sqrt(2 * np.log(np.maximum(ratio, 1))[:, None] * cov2d[:, [0, 2]]) + SLACK
        extents = np.maximum(extents, np.where(ratio[:, None] >= 1, half, -np.inf))
    order = depth_order(projection)
    centres = projection.means2d[order]
    low, high = centres - extents[order], centres + extents[order]
    boxes = tile_boxes(camera.width, camera.height, TILE_SIZE, TILE_SIZE)
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
            yield Block((slice(y0, y1), slice(x0, x1)), order[found], dx, dy)


def _gaussian(opacities: np.ndarray, cov2d: np.ndarray, conics: np.ndarray, dx: np.ndarray,
              dy: np.ndarray) -> np.ndarray:
    """[n, h, w]. q as a sum of two squares, which keeps its precision on needles far from their centre."""
    sheared = dx[:, None, :] - ((cov2d[:, 1] / cov2d[:, 2])[:, None] * dy)[:, :, None]
    q = conics[:, 0, None, None] * sheared**2 + (dy**2 / cov2d[:, 2, None])[:, :, None]
    return opacities[:, None, None] * np.exp(-0.5 * q)


def _varied(offsets: np.ndarray, slopes: np.ndarray, curvatures: np.ndarray) -> np.ndarray:
    """[m, h, w, 3] at offsets [m, h, w, 2] from the centres."""
    brighter = ((offsets @ curvatures[:, None]) * offsets).sum(-1) / 2
    return offsets @ slopes.swapaxes(1, 2)[:, None] + brighter[..., None]


class Cut:
    """What a `plane` does to the primitives of a block: `rows` [k] of it, which it cuts off.

    n.w is what it has changed by in x, `in_x` [k, 1, w], and in y, `in_y` [k, h, 1].
    """

    def __init__(self, plane: int, rows: np.ndarray, per_pixel: np.ndarray, block: Block):
        of_x, of_y = per_pixel[rows].T
        self.plane, self.rows = plane, rows
        self.in_x, self.in_y = (of_x * block.dx[rows].T).T[:, None, :], (of_y * block.dy[rows].T).T[:, :, None]

    def log_kept_slope(self) -> np.ndarray:
        """[k, h, w] the derivative of log g by n.w."""
        return log_kept_slope(self.in_x + self.in_y)


class Blending:
    """The pixels of a block, blended front to back; arrays are [n, h, w].

    `moved`: each comparison with a cutoff is made stricter by this share of the cutoff and by what float32 may have
    rounded on the way there, or, where it is negative, more lenient by as much.
    """

    def __init__(self, projection: Projection, block: Block, negative_transmittance: bool, min_alpha: float,
                 min_transmittance: float, moved: float = 0.0):
        p, i = projection, block.splats
        self.dog = np.flatnonzero(p.dog[i])  # [m] rows of the block
        self._evaluate_kernels(p, block)
        self.colors = p.colors[i]  # [n, 3] at the centres
        self.varying = np.flatnonzero((p.sloped | p.curved)[i])  # [m] rows of the block, whose colours vary over them
        of_x, of_y = block.dx[self.varying, None, :], block.dy[self.varying, :, None]
        self.offsets = np.stack(np.broadcast_arrays(of_x, of_y), -1)  # [m, h, w, 2]
        self.slopes, self.curvatures = p.slopes[i[self.varying]], p.curvatures[i[self.varying]]  # [m, 3, 2], [m, 2, 2]
        self._walk(negative_transmittance, min_alpha, min_transmittance, moved)

    def _evaluate_kernels(self, p: Projection, block: Block) -> None:
        """G, and G_p [m, h, w] of those that are DoG, with what cuts leave of them."""
        i, of_dog = block.splats, block.splats[self.dog]
        self.G = _gaussian(p.opacities[i], p.cov2d[i], p.conics[i], block.dx, block.dy)
        self.G_p = _gaussian(p.pseudo_opacities[of_dog], p.pseudo_cov2d[of_dog], p.pseudo_conics[of_dog],
                             block.dx[self.dog], block.dy[self.dog])
        self.cuts = [Cut(k, np.flatnonzero(cut[i]), p.cuts[k, i], block) for k, cut in enumerate(p.cut) if cut[i].any()]
        for cut in self.cuts:
            left = np.ones_like(self.G)
            left[cut.rows] = kept(cut.in_x + cut.in_y)
            self.G *= left
            self.G_p *= left[self.dog]

    def _walk(self, negative_transmittance: bool, min_alpha: float, min_transmittance: float, moved: float) -> None:
        """alpha, 0 of what is not `blended`, and T: in front of each primitive, and at the end."""
        alpha = np.minimum(MAX_ALPHA, self.G)
        alpha[self.dog] -= np.minimum(MAX_ALPHA, self.G_p)
        slack = moved * min_alpha + np.sign(moved) * KERNEL_UNITS * UNIT * self.operands() if moved else 0.0
        self.blended = np.abs(alpha) >= min_alpha + slack
        alpha[~self.blended] = 0
        self.alpha = alpha
        self.attenuates = np.ones_like(self.blended) if negative_transmittance else alpha > 0
        with np.errstate(over="ignore"):  # beyond the end of the walk
            behind = np.cumprod(1 - np.where(self.attenuates, alpha, 0), axis=0)
        slack = moved + np.sign(moved) * self.roundings() if moved else 0.0
        beyond = (behind < min_transmittance * (1 + slack)) | (behind > MAX_T * (1 - slack))
        ended = np.logical_or.accumulate(beyond, axis=0)
        if ended.any():
            alpha[ended] = 0
            self.blended &= ~ended
            behind = np.cumprod(1 - np.where(self.attenuates, alpha, 0), axis=0)
        self.T = np.concatenate([np.ones_like(behind[:1]), behind[:-1]])
        self.T_final = behind[-1]  # [h, w]

    def sum_of_colors(self, weights: np.ndarray, variations: np.ndarray) -> np.ndarray:
        """[h, w, 3] sum of weights [n, h, w] times the colours, to which `variations` [m, h, w, 3] are added."""
        image = np.tensordot(weights, self.colors, (0, 0))
        if self.varying.size:
            image += np.einsum("nhw,nhwc->hwc", weights[self.varying], variations)
        return image

    def colors_times(self, δpixels: np.ndarray) -> np.ndarray:
        """[n, h, w] the colour of each primitive at each pixel times the adjoint of the pixel [h, w, 3]."""
        products = np.tensordot(self.colors, δpixels, (1, 2))
        if self.varying.size:
            products[self.varying] += np.einsum("hwc,nhwc->nhw", δpixels, self.variations())
        return products

    def variations(self) -> np.ndarray:
        """[m, h, w, 3] what slopes and curvatures add to the colours."""
        return _varied(self.offsets, self.slopes, self.curvatures)

    def terms(self) -> np.ndarray:
        """[m, h, w, 3] sums of magnitudes of what such a colour is added up from."""
        terms = _varied(*(np.abs(values) for values in (self.offsets, self.slopes, self.curvatures)))
        return self.colors[self.varying, None, None] + terms

    def operands(self) -> np.ndarray:
        """G + G_p, of which alpha is the difference; with a cut more, by what the terms of its exponent round off."""
        operands = self.G.copy()
        operands[self.dog] += self.G_p
        for cut in self.cuts:
            terms = OFFSET + np.abs(cut.in_x) + np.abs(cut.in_y)
            operands[cut.rows] *= 1 + cut.log_kept_slope() * terms
        return operands

    def roundings(self) -> np.ndarray:
        """By how much float32 may change T behind each primitive, relative and to first order.

        T is the product of all 1 - alpha. So relative errors add, whether T falls or grows: of each factor that of the
        kernels, divided by the factor, and those of its two operations.
        """
        factors = self.operands() / (1 - self.alpha) + 1
        return MEAN_UNITS * UNIT * np.cumsum(np.where(self.blended, factors, 0), axis=0)

    def backward(self, δpixels_colors: np.ndarray, δpixels_background: np.ndarray) -> np.ndarray:
        """δalpha [n, h, w], from the adjoint of the pixels times each colour [n, h, w], and background [h, w]."""
        contributions = self.alpha * self.T * δpixels_colors
        from_back = np.concatenate([(self.T_final * δpixels_background)[None], contributions[:0:-1]])
        behind = np.cumsum(from_back, axis=0)[::-1]
        δalpha = self.T * δpixels_colors - np.where(self.attenuates, behind / (1 - self.alpha), 0)
        return np.where(self.blended, δalpha, 0)
