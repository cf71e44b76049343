"""The training loss 0.8 L1 + 0.2 (1 - SSIM) and its gradient, written out by hand in four kernels.

Notation, per channel: ``x`` the rendered image clamped to [0, 1] (after a tone curve to at least 0), ``y`` the target,
``E[.]`` the mean under SSIM's 11x11 Gaussian window with zeros outside the image, and

    SSIM = A1 A2 / (B1 B2)    A1 = 2 E[x] E[y] + C1          A2 = 2 (E[xy] - E[x] E[y]) + C2
                              B1 = E[x]^2 + E[y]^2 + C1      B2 = E[x^2] - E[x]^2 + E[y^2] - E[y]^2 + C2.

The window is symmetric, so blurring is its own adjoint (zero padding included) and with ``S = sum of SSIM``

    dS/dx = E[dS/dE[x]] + 2 x E[dS/dE[x^2]] + y E[dS/dE[xy]].

The window is separable: four passes, each *across* the rows of its input (``blur.py``), which is transposed by that.

    1  image [y, x]: blur along y             -> E_y[x], E_y[x^2], E_y[xy]       transposed, [x, y]
    2  blur along x, SSIM and its derivatives -> dS/dE[x], dS/dE[x^2], dS/dE[xy]  in the lanes' own order
    3  blur along x again, same lanes         -> transposed back, [y, x]
    4  blur along y, combine, add L1          -> gradient [y, x]

Between 2 and 3 nothing moves: a lane reads its own block directly and gathers only from its two neighbours.
What depends on the target alone (E[y], E[y^2]) is computed once per training image. The passes are recorded once per
image size, and replayed: tracing them would take Python longer than an adjoint pass of the rasterisation.

Sources: Wang et al. 2004 (SSIM); Kerbl et al. 2023 (the weights, the zero padding).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.arrays import array_types, constant, detached
from ...engine.frozen import frozen
from ...engine.parameters import device_array
from .blur import BLOCK, Sweep, blur

C1, C2 = 0.01**2, 0.03**2


@dataclass
class Sweeps:
    """The blurs of an image of some size along both axes, and what else the kernels need to know about it."""

    n_values: int
    along_y: Sweep
    along_x: Sweep
    most: float = 1.0  # that images are clamped to

    @staticmethod
    def of(width: int, height: int, most: float = 1.0) -> Sweeps:
        return Sweeps(3 * width * height, Sweep.of(height, width), Sweep.of(width, height), most)


@dataclass
class Target:
    """A training image with what SSIM needs of it; made by ``PhotometricLoss``, once per image, or, where memory is
    short, whenever it is due.

    ``rows`` (the image), ``mean`` = E[y] and ``mean_sq`` = E[y^2] are in the order of the lanes that read
    them; together they take three times the memory of the image in float32.
    """

    width: int
    height: int
    sweeps: Sweeps
    rows: list
    mean: list
    mean_sq: list

    @staticmethod
    def of(y: Any, width: int, height: int, sweeps: Sweeps) -> Target:
        """``y``: the image as an evaluated array, planar, [3 H W]."""
        return Target(width, height, sweeps, *_rows_and_moments(y, sweeps))


class PhotometricLoss:
    """(1 - dssim_weight) L1 + dssim_weight (1 - SSIM), both means over pixels and channels.

    Images are planar: three planes [H W], row by row, or the three joined in one array [3 H W]. Those of display values
    are clamped to [0, ``most``]; what a tone curve makes of radiance has no end there.
    """

    def __init__(self, dssim_weight: float = 0.2, most: float = 1.0):
        self.dssim_weight, self.most = dssim_weight, most
        self._sweeps_of_sizes: dict[tuple[str | None, int, int], Sweeps] = {}

    def target(self, image: np.ndarray) -> Target:
        """Prepare a training image [H, W, 3]. Raises ValueError for another shape."""
        if image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
            raise ValueError(f"target: image has shape {image.shape}; [height, width, 3] is needed")
        height, width = image.shape[:2]
        y = detached(device_array(image.transpose(2, 0, 1)))  # [3 H W]
        return Target.of(y, width, height, self._sweeps(width, height))

    def target_of_planes(self, planes: list[Any], width: int, height: int) -> Target:
        """Prepare a training image that is on the device already, as three planes [H W] or one array [3 H W]."""
        sweeps = self._sweeps(width, height)
        return Target.of(self._joined(planes, sweeps), width, height, sweeps)

    def _sweeps(self, width: int, height: int) -> Sweeps:
        key = (mi.variant(), width, height)
        if key not in self._sweeps_of_sizes:
            self._sweeps_of_sizes[key] = Sweeps.of(width, height, self.most)
        return self._sweeps_of_sizes[key]

    def value_and_gradient(self, image: Any, target: Target) -> tuple[Any, Any, Any, Any]:
        """L1, 1 - SSIM, the loss (one value each, not waited for), and d loss / d image in the form given.

        ``image`` is a list of three planes [H W], or one array [3 H W]. It is clamped here; the
        gradient is zero where that changed it. Raises ValueError if image and target differ in size.
        """
        joined = self._join(image, target, "value_and_gradient")
        weights = {"l1": 1 - self.dssim_weight, "ssim": -self.dssim_weight, "all": 1}
        scales = [constant(type(joined), name, w / target.sweeps.n_values) for name, w in weights.items()]
        l1_scale, ssim_scale, scale = scales
        l1_sum, ssim_sum, gradient = _sums_and_gradient(joined, target, l1_scale, ssim_scale)
        l1, dssim = l1_sum * scale, 1 - ssim_sum * scale
        if isinstance(image, (list, tuple)) and len(image) == 3:
            gradient = [dr.gather(type(joined), gradient, at) for at in self._plane_indices(target.sweeps)]
        return l1, dssim, dr.lerp(l1, dssim, self.dssim_weight), gradient

    def l1(self, image: Any, target: Target) -> Any:
        """The L1 of ``value_and_gradient`` alone, for less than the half of its work."""
        joined = self._join(image, target, "l1")
        sweep, total = target.sweeps.along_y, type(joined)(0)
        for (index, inside), y in zip(sweep.indices(sweep.columns, range(BLOCK)), target.rows, strict=True):
            total += dr.abs(dr.clip(dr.gather(type(joined), joined, index, inside), 0, target.sweeps.most) - y)
        return dr.sum(total) * dr.opaque(type(joined), 1 / target.sweeps.n_values)

    def _plane_indices(self, sweeps: Sweeps) -> list[Any]:
        """Where each of the three planes lies in the joined array."""
        sweep = sweeps.along_y
        pixel = dr.arange(type(sweep.column), sweeps.n_values // 3)
        return [dr.fma(sweep.rows * c, sweep.columns, pixel) for c in range(3)]

    def _join(self, image: Any, target: Target, caller: str) -> Any:
        """Three planes (evaluated or not), or one, as one evaluated array, in one kernel; their sizes checked."""
        planes = list(image) if isinstance(image, (list, tuple)) else [image]
        n, sizes = target.sweeps.n_values, [dr.width(p) for p in planes]
        if sizes != [n // 3] * 3 and sizes != [n]:
            raise ValueError(
                f"{caller}: image has planes of {sizes} values, "
                f"target {target.width}x{target.height} needs three of {n // 3} (or all in one)"
            )
        return self._joined(planes, target.sweeps)

    def _joined(self, planes: list[Any], sweeps: Sweeps) -> Any:
        planes = detached(planes)
        if len(planes) == 1:
            joined = planes[0]
        else:
            joined = dr.empty(type(planes[0]), sweeps.n_values)
            for plane, at in zip(planes, self._plane_indices(sweeps), strict=True):
                dr.scatter(joined, plane, at, mode=dr.ReduceMode.Permute)
        dr.eval(joined)
        return joined


@frozen
def _rows_and_moments(y: Any, sweeps: Sweeps) -> tuple[list, list, list]:
    """``rows``, ``mean`` and ``mean_sq`` of a ``Target``."""
    at = sweeps.along_y.indices(sweeps.along_y.columns, range(BLOCK))
    rows = [dr.gather(type(y), y, index, inside) for index, inside in at]
    dr.eval(rows)
    (values,) = sweeps.along_y.values_from_blocks([rows])
    blurred = sweeps.along_y.store_transposed([blur(values), blur([v * v for v in values])])
    mean, mean_sq = (blur(v) for v in sweeps.along_x.values(blurred, sweeps.along_y.transposed_stride))
    dr.eval(mean, mean_sq)
    return rows, mean, mean_sq


@frozen
def _sums_and_gradient(image: Any, target: Target, l1_scale: Any, ssim_scale: Any) -> tuple[Any, Any, Any]:
    """The sums of |x - y| and of SSIM, and the gradient of the loss, in which they are scaled."""
    ssim_sum, derivatives = _ssim(_moments_along_y(image, target), target)
    l1_sum, gradient = _combine(image, derivatives, target, l1_scale, ssim_scale)
    return l1_sum, ssim_sum, gradient


def _moments_along_y(image: Any, target: Target) -> list[Any]:
    """Pass 1: x, x^2 and xy blurred along y; planes [3, W, H padded]."""
    sweep = target.sweeps.along_y
    x = [dr.clip(v, 0, target.sweeps.most) for v in sweep.values([image], sweep.columns)[0]]
    (y,) = sweep.values_from_blocks([target.rows])
    x_sq, xy = [a * a for a in x], [a * b for a, b in zip(x, y, strict=True)]
    return sweep.store_transposed([blur(x), blur(x_sq), blur(xy)])


def _ssim(blurred: list[Any], target: Target) -> tuple[Any, list[Any]]:
    """Passes 2 and 3: the sum of SSIM; its derivatives blurred along x, planes [3, H, W padded]."""
    sweep = target.sweeps.along_x
    moments = [blur(v) for v in sweep.values(blurred, target.sweeps.along_y.transposed_stride)]
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
    ssim_sum = _evaluated_sum(ssim_sum, derivatives)
    values = sweep.values_from_blocks(derivatives)
    return ssim_sum, sweep.store_transposed([blur(v) for v in values])


def _combine(image: Any, derivatives: list[Any], target: Target, l1_scale: Any, ssim_scale: Any) -> tuple[Any, Any]:
    """Pass 4: the sum of |x - y|, and the gradient of the loss."""
    sweep = target.sweeps.along_y
    Float: Any = type(image)
    means = [blur(v) for v in sweep.values(derivatives, target.sweeps.along_x.transposed_stride)]
    l1_sum, gradient = Float(0), dr.empty(Float, target.sweeps.n_values)
    at = sweep.indices(sweep.columns, range(BLOCK))
    for (index, inside), y, d_mean, d_sq, d_xy in zip(at, target.rows, *means, strict=True):
        raw = dr.gather(Float, image, index, inside)
        x = dr.clip(raw, 0, target.sweeps.most)
        difference = x - y
        l1_sum += dr.abs(difference)
        d_ssim = dr.fma(2 * x, d_sq, dr.fma(y, d_xy, d_mean))
        d_l1 = dr.select(difference == 0, 0, dr.copysign(l1_scale, difference))
        value = dr.select(raw == x, dr.fma(ssim_scale, d_ssim, d_l1), 0)
        # Permute promises distinct addresses; without it Dr.Jit launches one kernel per scatter
        dr.scatter(gradient, value, index, inside, mode=dr.ReduceMode.Permute)
    return _evaluated_sum(l1_sum, gradient), gradient


def _evaluated_sum(values: Any, others: Any) -> Any:
    """The sum of ``values``, which a kernel computes together with ``others``.

    On CUDA the kernel itself adds them up, in any order, which saves two launches; on the CPU the sum has the same bits
    in every run.
    """
    if array_types().is_llvm:
        dr.eval(values, others)
        return dr.sum(values)
    total = dr.zeros(type(values), 1)
    dr.scatter_add(total, values, 0, mode=dr.ReduceMode.Local)
    dr.eval(total, others)
    return total
