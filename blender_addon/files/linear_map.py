"""Linear maps that are no similarity, such as a scale that differs along the axes: kernels exactly, colours nearly.

The same as ``mi_dogsplat.scene.linear_map``, which has the formulas: a copy on purpose, as the add-on runs without the
package. ``tests/project/test_addon_numbers.py`` compares the two.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .model import ALONG_AXES, Model, normalized
from .rotation import quaternion_from_rotation, rotations
from .sh import sh_basis

POLAR, AROUND = 64, 128  # directions of the quadrature: exact to rounding up to ratios of 10 to 1
ROWS, COLUMNS = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]  # of the matrix Q whose entries curvatures are
OF_MATRIX = [[0, 3, 4], [3, 1, 5], [4, 5, 2]]  # which of them its entries are
LEAST = 1e-36  # scale that is told from nothing
FLATTEST = 1e-7  # smallest over largest singular value of a map that can be undone in float32


def flattens(linear: NDArray) -> bool:
    """Whether a [3, 3] map leaves a plane, a line or a point."""
    sizes = np.linalg.svd(linear, compute_uv=False)
    return not sizes[-1] > FLATTEST * sizes[0]


def is_similarity(linear: NDArray) -> bool:
    """Whether a [3, 3] turns and scales evenly, and mirrors nothing."""
    scale = np.cbrt(np.linalg.det(linear))
    return bool(scale > 0 and np.allclose(linear @ linear.T, scale**2 * np.eye(3), atol=1e-4 * scale**2))


def check_regular(linear: NDArray) -> None:
    """Raise ``ValueError`` for a [3, 3] map that flattens."""
    if flattens(linear):
        raise ValueError("splats cannot be flattened, but this object is scaled to nothing along an axis")


def mapped(model: Model, linear: NDArray) -> Model:
    """A model after a regular map [3, 3], its means left as they are."""
    scales = np.exp(model.log_scales.astype(np.float64))
    axes = rotations(normalized(model.quats).astype(np.float64))  # [N, 3, 3]
    columns = linear @ axes
    u, sizes, _ = np.linalg.svd(columns * scales[:, None])
    u = u * np.where(np.linalg.det(u) < 0, -1.0, 1.0)[:, None, None]  # a rotation, no reflection: Σ' is the same
    sizes = np.maximum(sizes, LEAST)
    factors = np.exp(np.where(model.is_dog[:, None], model.dog_log_scales, 0).astype(np.float64))
    pseudo = u.swapaxes(1, 2) @ columns * (factors * scales)[:, None]  # rows are the new axes
    log_factors = np.log(np.linalg.norm(pseudo, axis=2) / sizes)
    along = u.swapaxes(1, 2) @ columns * scales[:, None] / sizes[:, :, None]  # from old deviations to new ones
    taken = {group.values: _taken_along(along, getattr(model, group.values)) for group in ALONG_AXES}
    project = sh_projection(linear, model.sh_degree)
    return replace(
        model,
        log_scales=np.log(sizes).astype(np.float32),
        quats=quaternion_from_rotation(u).astype(np.float32),
        sh_coeffs=np.einsum("ij,njc->nic", project, model.sh_coeffs.astype(np.float64)).astype(np.float32),
        dog_log_scales=np.where(model.is_dog[:, None], log_factors, model.dog_log_scales).astype(np.float32),
        brightness_curvatures=_turned(along, model.brightness_curvatures),
        shifts=_shifted(model.shifts, linear, along, axes, u),
        **taken,
    )


def _taken_along(along: NDArray, values: NDArray) -> NDArray[np.float32]:
    """Values [N, 3 or 0, ...] per standard deviation of each axis, which an orthogonal [N, 3, 3] takes along."""
    k = values.shape[1]
    return np.einsum("nij,nj...->ni...", along[:, :k, :k], values.astype(np.float64)).astype(np.float32)


def _turned(along: NDArray, curvatures: NDArray) -> NDArray[np.float32]:
    """Curvatures [N, 6 or 0] of the matrices T Q Tᵀ, those of Q turned by an orthogonal T [N, 3, 3]."""
    if not curvatures.shape[1]:
        return curvatures
    turned = along @ curvatures.astype(np.float64)[:, OF_MATRIX] @ along.swapaxes(1, 2)
    return turned[:, ROWS, COLUMNS].astype(np.float32)


def _shifted(shifts: NDArray, linear: NDArray, along: NDArray, before: NDArray, after: NDArray) -> NDArray[np.float32]:
    """Shifts [N, 4 or 0, 3] of primitives with the axes R' ``after`` a map, which had R ``before``, both [N, 3, 3].

    An orthogonal T, ``along`` [N, 3, 3], takes their moves to the new axes. A view v' along these is D v' along the old
    ones, D = Rᵀ K R' with the matrix K of ``view_projection``. So A becomes T A D, and the mean view v̄ becomes D⁻¹ v̄.
    """
    if not shifts.shape[1]:
        return shifts
    directions = before.swapaxes(1, 2) @ view_projection(linear) @ after
    moves = along @ shifts[:, :3].astype(np.float64) @ directions
    views = shifts[:, 3:].astype(np.float64) @ np.linalg.inv(directions).swapaxes(1, 2)
    return np.concatenate([moves, views], axis=1, dtype=np.float32)


def sh_projection(linear: NDArray, degree: int) -> NDArray[np.float64]:
    """Matrix [K, K] from the coefficients of f to those nearest to d ↦ f(A⁻¹ d / |A⁻¹ d|)."""
    directions, weights, back = _sphere(linear)
    return (sh_basis(directions, degree) * weights[:, None]).T @ sh_basis(back, degree)


def view_projection(linear: NDArray) -> NDArray[np.float64]:
    """Matrix [3, 3] that takes a unit vector d as near to A⁻¹ d / |A⁻¹ d| as one can: in the mean of squares."""
    directions, weights, back = _sphere(linear)
    return 3 / (4 * np.pi) * (back * weights[:, None]).T @ directions


def _sphere(linear: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """(Directions d [D, 3] of the quadrature, their weights [D], A⁻¹ d / |A⁻¹ d| [D, 3])."""
    heights, weights = np.polynomial.legendre.leggauss(POLAR)
    angles = np.arange(AROUND) * 2 * np.pi / AROUND
    z, angle = (grid.ravel() for grid in np.meshgrid(heights, angles, indexing="ij"))
    radius = np.sqrt(1 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    back = directions @ np.linalg.inv(linear).T
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    return directions, np.repeat(weights * 2 * np.pi / AROUND, AROUND), back
