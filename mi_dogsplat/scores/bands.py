"""What the bands of view-dependent colour contribute to the training views, primitive by primitive.

The picture is linear in the colours: with w the weight α T of primitive i at a pixel, y_v the basis functions in its
direction from view v, and u the change of its SH coefficients in a channel, the pictures change by w y_v·u. Its energy

    Σ_v h_v (y_v·u)² = uᵀ H u,   H = Σ_v h_v y_v y_vᵀ,   h_v = Σ w² over the pixels of view v

is in the units of the leave-one-out score (``walks/score.py``: Σ D²), and as exact: for a change of any size, all
other primitives staying as they are.

Without the bands above a degree, u_U = -x_U is given there and the coefficients below, L, are fitted anew: a least
squares problem of 1, 4 or 9 unknowns that the three channels share,

    u_L = -(H_LL + R)⁻¹ H_LU u_U,

whose energy without R is the Schur complement, x_Uᵀ (H_UU - H_UL H_LL⁻¹ H_LU) x_U. R is a small ridge: few views
leave directions of u_L open, along which the fit would run away for nothing. What is reported is the change for this
u_L, without the ridge's own part.

A colour below 0 is shown as 0. Here it counts as if it were shown as it is: an upper bound where bands pull the
colour of a view below 0, the exact value elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.arrays import array_types, detached
from ..engine.sh import unit_basis
from ..scene.sh_basis import SH_SIZES, sh_degree_of
from .squared_weights import squared_weights
from .training_views import TrainingViews

RIDGE = 1e-3  # of what the diagonal of H would be if the views came from all around
ROWS = 16_384  # primitives at a time on the host, which bounds the memory: 2 KB each at degree 3


@dataclass(frozen=True)
class Bands:
    """The least squares problem of each primitive, at the coefficients ``x`` [N, K, 3]; as ``bands`` makes it."""

    x: np.ndarray
    H: list[np.ndarray]  # upper triangle of H row by row, [N] each

    def losses(self) -> np.ndarray:
        """[N, degrees] float64: what is lost by keeping the bands up to degree 0, 1, ... alone; 0 for the last."""
        parts = [np.stack([self._fitted(*part, d)[0] for d in self._degrees], 1) for part in self._parts()]
        return np.concatenate([np.zeros((0, len(self._degrees))), *parts])

    def fitted(self, degrees: np.ndarray) -> np.ndarray:
        """[N, K, 3] coefficients without the bands above ``degrees`` [N]: zeros there, below what loses least.

        Primitives that keep all their bands keep their coefficients.
        """
        result = self.x.astype(np.float64)
        start = 0
        for x, H in self._parts():
            rows = slice(start, start + len(x))
            for degree in self._degrees[:-1]:
                lowered = np.flatnonzero(degrees[rows] == degree)
                result[start + lowered] += self._fitted(x[lowered], H[lowered], degree)[1]
            start += len(x)
        return result.astype(np.float32)

    @property
    def _degrees(self) -> range:
        return range(sh_degree_of(self.x.shape[1]) + 1)

    def _parts(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """x [n, K, 3] and H [n, K, K] of some rows at a time, in float64."""
        k = self.x.shape[1]
        upper = np.triu_indices(k)
        for start in range(0, len(self.x), ROWS):
            rows = slice(start, start + ROWS)
            x = self.x[rows].astype(np.float64)
            H = np.zeros((len(x), k, k))
            for i, j, column in zip(*upper, self.H, strict=True):
                H[:, i, j] = H[:, j, i] = column[rows]
            yield x, H

    @staticmethod
    def _fitted(x: np.ndarray, H: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
        """Loss [n] of dropping the bands above ``degree``, and the change u [n, K, 3] that does it."""
        size = SH_SIZES[degree]
        lower, upper = slice(0, size), slice(size, None)
        ridge = RIDGE * H[:, 0, 0] + np.finfo(np.float32).tiny  # H_00 is Σ h / 4π, the mean of y² over the sphere
        solved = H[:, lower, lower] + ridge[:, None, None] * np.eye(size)
        u = -x
        u[:, lower] = -np.linalg.solve(solved, H[:, lower, upper] @ u[:, upper])
        return np.einsum("nkc,nkc->n", u, H @ u), u


def bands(params: dict, x: np.ndarray, views: TrainingViews) -> Bands:
    """Walk through all views.

    Args:
        params: as in ``rasterize``.
        x: [N, K, 3] the SH coefficients in them, K that of the highest degree.
        views: of pinholes, as photographs are.

    Takes 4 K (K + 1) / 2 bytes a primitive on the device.
    """
    types, n, k = array_types(), len(x), x.shape[1]
    pairs = list(zip(*np.triu_indices(k), strict=True))
    if n == 0:
        return Bands(x, [np.zeros(0)] * len(pairs))
    params = dr.detach(params)
    index = dr.arange(mi.UInt32, n)
    means = [dr.gather(mi.Float, params["means"], dr.fma(index, 3, axis)) for axis in range(3)]
    H = [dr.zeros(types.Float, n) for _ in pairs]
    for view, camera in enumerate(views.cameras):
        h = squared_weights(params, views, view)
        y = detached(unit_basis(camera.offset(means), sh_degree_of(k)))
        seen = h > 0
        for at, (i, j) in enumerate(pairs):
            H[at] = dr.select(seen, dr.fma(h * y[i], y[j], H[at]), H[at])
        dr.eval(H)
    return Bands(x, [column.numpy() for column in H])
