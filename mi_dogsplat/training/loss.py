"""The training loss 0.8 L1 + 0.2 (1 - SSIM) and its gradient, written out by hand in four kernels.

Notation, per channel: ``x`` the rendered image clamped to [0, 1], ``y`` the target, ``E[.]`` the mean under
SSIM's 11x11 Gaussian window with zeros outside the image, and

    SSIM = A1 A2 / (B1 B2)    A1 = 2 E[x] E[y] + C1          A2 = 2 (E[xy] - E[x] E[y]) + C2
                              B1 = E[x]^2 + E[y]^2 + C1      B2 = E[x^2] - E[x]^2 + E[y^2] - E[y]^2 + C2.

The window is symmetric, so blurring is its own adjoint (zero padding included) and with ``S = sum of SSIM``

    dS/dx = E[dS/dE[x]] + 2 x E[dS/dE[x^2]] + y E[dS/dE[xy]].

How it is made fast. The window is separable, and a lane computes ``BLOCK`` neighbouring outputs, so that
each loaded value serves up to eight of them. Every pass runs *across* the rows of its input (consecutive
lanes read consecutive addresses); a lane's eight outputs are then consecutive in the *transposed* plane, one
packet store:

    1  image [y, x]: blur along y             -> E_y[x], E_y[x^2], E_y[xy]       transposed, [x, y]
    2  blur along x, SSIM and its derivatives -> dS/dE[x], dS/dE[x^2], dS/dE[xy]  in the lanes' own order
    3  blur along x again, same lanes         -> transposed back, [y, x]
    4  blur along y, combine, add L1          -> gradient [y, x]

Between 2 and 3 nothing moves: a lane reads its own block directly and gathers only from its two neighbours.
What depends on the target alone (E[y], E[y^2]) is computed once per training image. Sizes are opaque: images
of all sizes share the kernels.

Sources: Wang et al. 2004 (SSIM); Kerbl et al. 2023 (the weights, the zero padding).
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.arrays import array_types, detached
from ..engine.parameters import device_array

RADIUS = 5
BLOCK = 8  # a power of two (packet stores), at least RADIUS (a window reaches no further than the next block)
C1, C2 = 0.01**2, 0.03**2


def gaussian_window() -> list[float]:
    """The 11 weights of SSIM's window along one axis (sigma 1.5, sum 1)."""
    weights = np.exp(-0.5 * (np.arange(-RADIUS, RADIUS + 1) / 1.5) ** 2)
    return (weights / weights.sum()).tolist()


WEIGHTS = gaussian_window()


class _Sweep:
    """A blur across the rows of planes [3, rows, columns]: one lane per channel, block of rows, and column.

    Columns vary fastest over the lanes. A lane's ``values`` are its rows -RADIUS ... BLOCK + RADIUS - 1,
    counted from the first row of its block, zero outside the image. A quantity "in the lanes' order" is a
    list of BLOCK arrays, one per row of the block, each with one entry per lane.
    """

    def __init__(self, rows: int, columns: int):
        self.UInt = array_types().UInt
        n_blocks = -(-rows // BLOCK)
        channel, block, column = np.indices((3, n_blocks, columns), np.uint32).reshape(3, -1)
        # arrays that share memory with NumPy are aligned by chance, and each chance is another kernel
        self.channel, self.column, self.first = (  # first: row, of the lane's block
            detached(device_array(v, mi.UInt32)) for v in (channel, column, block * BLOCK)
        )
        self.rows, self.columns = dr.opaque(self.UInt, rows), dr.opaque(self.UInt, columns)
        self.n_blocks = dr.opaque(self.UInt, n_blocks)
        self.transposed_stride = dr.opaque(self.UInt, n_blocks * BLOCK)
        self.transposed_size = 3 * columns * n_blocks * BLOCK

    def row(self, j: int) -> tuple[Any, Any]:
        """Row ``j`` of the block, counted in its channel, and whether it lies in the image."""
        row = self.first + self.UInt(j % 2**32)  # wraps above the image, and so fails the comparison
        return row, row < self.rows

    def indices(self, stride: Any, span: range) -> list[tuple[Any, Any]]:
        """Index and mask of the rows ``span`` of the block in a plane whose rows are ``stride`` apart."""
        base = dr.fma(self.channel * self.rows, stride, self.column)
        return [(dr.fma(row, stride, base), inside) for row, inside in map(self.row, span)]

    def values(self, planes: list[Any], stride: Any) -> list[list[Any]]:
        """The lane's values from each of several planes, each [3, rows, stride]."""
        at = self.indices(stride, range(-RADIUS, BLOCK + RADIUS))
        return [[dr.gather(type(p), p, index, inside) for index, inside in at] for p in planes]

    def values_from_blocks(self, blocks: list[list[Any]]) -> list[list[Any]]:
        """The lane's values from quantities in the lanes' order (evaluated, zero outside the image)."""
        lane = dr.arange(self.UInt, dr.width(self.column))
        above, below = lane - self.columns, lane + self.columns
        head = [(BLOCK + j, above, self.row(j)[1]) for j in range(-RADIUS, 0)]
        tail = [(j, below, self.row(BLOCK + j)[1]) for j in range(RADIUS)]

        def gather(block: list[Any], at: list[tuple[int, Any, Any]]) -> list[Any]:
            return [dr.gather(type(block[k]), block[k], index, inside) for k, index, inside in at]

        return [[*gather(b, head), *b, *gather(b, tail)] for b in blocks]

    def store_transposed(self, blocks: list[list[Any]]) -> list[Any]:
        """Write quantities in the lanes' order as planes [3, columns, transposed_stride], in one kernel."""
        packet = dr.fma(dr.fma(self.channel, self.columns, self.column), self.n_blocks, self.first // BLOCK)
        Floats = array_types().Floats
        planes = []
        for block in blocks:
            plane = dr.empty(type(block[0]), self.transposed_size)
            dr.scatter(plane, Floats(block), packet)
            planes.append(plane)
        dr.eval(planes)
        return planes


def _blur(values: list[Any]) -> list[Any]:
    """Window means at a lane's BLOCK rows, from its BLOCK + 2 RADIUS values."""
    means = []
    for k in range(BLOCK):
        mean = values[k] * WEIGHTS[0]
        for value, weight in zip(values[k + 1 : k + len(WEIGHTS)], WEIGHTS[1:], strict=True):
            mean = dr.fma(value, weight, mean)
        means.append(mean)
    return means


class _Grid:
    """What the kernels need to know about an image size."""

    def __init__(self, width: int, height: int):
        self.n_values = 3 * width * height
        self.along_y = _Sweep(height, width)
        self.along_x = _Sweep(width, height)


class Target:
    """A training image with what SSIM needs of it; made by ``PhotometricLoss.target``, once per image.

    ``rows`` (the image), ``mean`` = E[y] and ``mean_sq`` = E[y^2] are in the order of the lanes that read
    them; together they take three times the memory of the image in float32.
    """

    def __init__(self, y: Any, width: int, height: int, grid: _Grid):
        """``y``: the image as an evaluated array, planar, [3 H W]."""
        self.height, self.width = height, width
        self.grid = grid
        Float: Any = type(y)
        at = grid.along_y.indices(grid.along_y.columns, range(BLOCK))
        self.rows = [dr.gather(Float, y, index, inside) for index, inside in at]
        dr.eval(self.rows)
        (values,) = grid.along_y.values_from_blocks([self.rows])
        blurred = grid.along_y.store_transposed([_blur(values), _blur([v * v for v in values])])
        moments = grid.along_x.values(blurred, grid.along_y.transposed_stride)
        self.mean, self.mean_sq = (_blur(values) for values in moments)
        dr.eval(self.mean, self.mean_sq)


class PhotometricLoss:
    """(1 - dssim_weight) L1 + dssim_weight (1 - SSIM), both means over pixels and channels.

    Images are planar: three planes [H W], row by row, or the three joined in one array [3 H W].
    """

    def __init__(self, dssim_weight: float = 0.2):
        self.dssim_weight = dssim_weight
        self._grids: dict[tuple[str | None, int, int], _Grid] = {}

    def target(self, image: np.ndarray) -> Target:
        """Prepare a training image [H, W, 3]. Raises ValueError for another shape."""
        if image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
            raise ValueError(f"target: image has shape {image.shape}; [height, width, 3] is needed")
        height, width = image.shape[:2]
        y = detached(device_array(image.transpose(2, 0, 1)))  # [3 H W]
        return Target(y, width, height, self._grid(width, height))

    def target_of_planes(self, planes: list[Any], width: int, height: int) -> Target:
        """Prepare a training image that is on the device already, as three planes [H W]."""
        grid = self._grid(width, height)
        return Target(self._joined(planes, grid), width, height, grid)

    def _grid(self, width: int, height: int) -> _Grid:
        key = (mi.variant(), width, height)
        if key not in self._grids:
            self._grids[key] = _Grid(width, height)
        return self._grids[key]

    def value_and_gradient(self, image: Any, target: Target) -> tuple[Any, Any, Any, Any]:
        """L1, 1 - SSIM, the loss (one value each, not waited for), and d loss / d image in the form given.

        ``image`` is a list of three planes [H W], or one array [3 H W]. It is clamped to [0, 1] here; the
        gradient is zero where that changed it. Raises ValueError if image and target differ in size.
        """
        joined = self._join(image, target, "value_and_gradient")
        blurred = self._moments_along_y(joined, target)
        ssim_sum, derivatives = self._ssim(blurred, target)
        l1_sum, gradient = self._combine(joined, derivatives, target)
        scale = dr.opaque(type(joined), 1 / target.grid.n_values)
        l1, dssim = l1_sum * scale, 1 - ssim_sum * scale
        if isinstance(image, (list, tuple)) and len(image) == 3:
            gradient = [dr.gather(type(joined), gradient, at) for at in self._plane_indices(target.grid)]
        return l1, dssim, dr.lerp(l1, dssim, self.dssim_weight), gradient

    def l1(self, image: Any, target: Target) -> Any:
        """The L1 of ``value_and_gradient`` alone, for less than the half of its work."""
        joined = self._join(image, target, "l1")
        sweep, total = target.grid.along_y, type(joined)(0)
        for (index, inside), y in zip(sweep.indices(sweep.columns, range(BLOCK)), target.rows, strict=True):
            total += dr.abs(dr.clip(dr.gather(type(joined), joined, index, inside), 0, 1) - y)
        return dr.sum(total) * dr.opaque(type(joined), 1 / target.grid.n_values)

    def _plane_indices(self, grid: _Grid) -> list[Any]:
        """Where each of the three planes lies in the joined array."""
        sweep = grid.along_y
        pixel = dr.arange(sweep.UInt, grid.n_values // 3)
        return [dr.fma(sweep.rows * c, sweep.columns, pixel) for c in range(3)]

    def _join(self, image: Any, target: Target, caller: str) -> Any:
        """Three planes (evaluated or not), or one, as one evaluated array, in one kernel; their sizes checked."""
        planes = list(image) if isinstance(image, (list, tuple)) else [image]
        n, sizes = target.grid.n_values, [dr.width(p) for p in planes]
        if sizes != [n // 3] * 3 and sizes != [n]:
            raise ValueError(
                f"{caller}: image has planes of {sizes} values, "
                f"target {target.width}x{target.height} needs three of {n // 3} (or all in one)"
            )
        return self._joined(planes, target.grid)

    def _joined(self, planes: list[Any], grid: _Grid) -> Any:
        planes = detached(planes)
        if len(planes) == 1:
            joined = planes[0]
        else:
            joined = dr.empty(type(planes[0]), grid.n_values)
            for plane, at in zip(planes, self._plane_indices(grid), strict=True):
                dr.scatter(joined, plane, at, mode=dr.ReduceMode.Permute)
        dr.eval(joined)
        return joined

    def _moments_along_y(self, image: Any, target: Target) -> list[Any]:
        """Pass 1: x, x^2 and xy blurred along y; planes [3, W, H padded]."""
        sweep = target.grid.along_y
        x = [dr.clip(v, 0, 1) for v in sweep.values([image], sweep.columns)[0]]
        (y,) = sweep.values_from_blocks([target.rows])
        x_sq, xy = [a * a for a in x], [a * b for a, b in zip(x, y, strict=True)]
        return sweep.store_transposed([_blur(x), _blur(x_sq), _blur(xy)])

    def _ssim(self, blurred: list[Any], target: Target) -> tuple[Any, list[Any]]:
        """Passes 2 and 3: the sum of SSIM; its derivatives blurred along x, planes [3, H, W padded]."""
        sweep = target.grid.along_x
        moments = [_blur(v) for v in sweep.values(blurred, target.grid.along_y.transposed_stride)]
        ssim_sum = type(blurred[0])(0)
        derivatives: list[list[Any]] = [[], [], []]
        for k, (mx, xx, xy, my, yy) in enumerate(zip(*moments, target.mean, target.mean_sq, strict=True)):
            _, inside = sweep.row(k)
            mx_my, squares = mx * my, dr.fma(mx, mx, my * my)
            a1, a2 = dr.fma(2, mx_my, C1), dr.fma(2, xy - mx_my, C2)
            b1, b2 = squares + C1, xx + yy - squares + C2
            inv_b = dr.select(inside, dr.rcp(b1 * b2), 0)  # makes everything below zero outside the image
            ssim = a1 * a2 * inv_b
            ssim_sum += ssim
            derivatives[0].append(2 * (my * (a2 - a1) * inv_b - mx * ssim * (b2 - b1) * inv_b))
            derivatives[1].append(-ssim * b1 * inv_b)
            derivatives[2].append(2 * a1 * inv_b)
        dr.eval(ssim_sum, derivatives)
        values = sweep.values_from_blocks(derivatives)
        return dr.sum(ssim_sum), sweep.store_transposed([_blur(v) for v in values])

    def _combine(self, image: Any, derivatives: list[Any], target: Target) -> tuple[Any, Any]:
        """Pass 4: the sum of |x - y|, and the gradient of the loss."""
        sweep = target.grid.along_y
        Float: Any = type(image)
        means = [_blur(v) for v in sweep.values(derivatives, target.grid.along_x.transposed_stride)]
        l1_scale = dr.opaque(Float, (1 - self.dssim_weight) / target.grid.n_values)
        ssim_scale = dr.opaque(Float, -self.dssim_weight / target.grid.n_values)
        l1_sum, gradient = Float(0), dr.empty(Float, target.grid.n_values)
        at = sweep.indices(sweep.columns, range(BLOCK))
        for (index, inside), y, d_mean, d_sq, d_xy in zip(at, target.rows, *means, strict=True):
            raw = dr.gather(Float, image, index, inside)
            x = dr.clip(raw, 0, 1)
            difference = x - y
            l1_sum += dr.abs(difference)
            d_ssim = dr.fma(2 * x, d_sq, dr.fma(y, d_xy, d_mean))
            d_l1 = dr.select(difference == 0, 0, dr.copysign(l1_scale, difference))
            value = dr.select(raw == x, dr.fma(ssim_scale, d_ssim, d_l1), 0)
            # Permute promises distinct addresses; without it Dr.Jit launches one kernel per scatter
            dr.scatter(gradient, value, index, inside, mode=dr.ReduceMode.Permute)
        dr.eval(l1_sum, gradient)
        return dr.sum(l1_sum), gradient
