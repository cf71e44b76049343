"""What densification adds up of every view: how much the image pulls at each primitive, and how large it is there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.arrays import array_types, constant, detached
from ...engine.parameters import device_array
from ...engine.project import Projection
from ...engine.screen_kernels import Kernels


def radii(kernels: Kernels) -> mi.Float:
    """[R] pixels, three standard deviations along the major axis, as in 3DGS; detached."""
    variance_x, variance_y = detached(kernels.variance_x), detached(kernels.variance_y)
    covariance = -detached(kernels.uy) / detached(kernels.ux) * variance_y  # ux : uy = yy : -xy
    mean, half_difference = 0.5 * (variance_x + variance_y), 0.5 * (variance_x - variance_y)
    variance = mean + dr.sqrt(dr.fma(half_difference, half_difference, covariance * covariance))
    return 3 * dr.sqrt(variance)


@dataclass
class DensifyStats:
    """State of ``Densification``: sums over the views since the last refinement, [N] on the device.

    Adding a view waits for nothing.
    """

    gradient_sum: Any
    views: Any
    max_radius: Any

    @staticmethod
    def zeros(n: int) -> DensifyStats:
        """Of no view."""
        Float = array_types().Float
        stats = DensifyStats(dr.zeros(Float, n), dr.zeros(Float, n), dr.zeros(Float, n))
        dr.make_opaque(stats.gradient_sum, stats.views, stats.max_radius)
        return stats

    def add(self, gradient_x, gradient_y, projection: Projection, width: int, height: int) -> None:
        """Add a view: gradients of the loss by the centres in pixels, and the projection they belong to."""
        Float = array_types().Float
        radius = radii(projection.kernels)
        x, y = detached(projection.x), detached(projection.y)
        w, h = constant(Float, "width", width), constant(Float, "height", height)
        seen = detached(projection.visible) & (x > -radius) & (x < w + radius)
        seen &= (y > -radius) & (y < h + radius)
        gx, gy = detached(gradient_x) * (0.5 * w), detached(gradient_y) * (0.5 * h)
        norm = dr.sqrt(dr.fma(gx, gx, gy * gy))
        self.gradient_sum += dr.select(seen & dr.isfinite(norm), norm, 0)
        self.views += dr.select(seen, 1, 0)
        self.max_radius = dr.maximum(self.max_radius, dr.select(seen, radius, 0))
        dr.schedule(self.gradient_sum, self.views, self.max_radius)

    def clear(self, n: int) -> None:
        """Begin anew, for ``n`` primitives."""
        new = DensifyStats.zeros(n)
        self.gradient_sum, self.views, self.max_radius = new.gradient_sum, new.views, new.max_radius

    def follow(self, index: np.ndarray) -> None:
        """Row r is a copy of the old row ``index[r]``, as in the optimizer."""
        types = array_types()
        old_row = detached(device_array(index, mi.UInt32))
        for name in ("gradient_sum", "views", "max_radius"):
            setattr(self, name, dr.gather(types.Float, getattr(self, name), old_row))
        dr.eval(self.gradient_sum, self.views, self.max_radius)

    def mean_gradient(self) -> np.ndarray:
        """[N] mean over the views that saw the primitive; 0 if none did."""
        return self.gradient_sum.numpy() / np.maximum(self.views.numpy(), 1)
