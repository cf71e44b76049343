"""Linear maps that are no similarity, such as a scale that differs along the axes: kernels exactly, colours nearly.

A primitive with axes R and scales s has the covariance Σ = R diag(s²) Rᵀ; a map A makes AΣAᵀ of it, again a Gaussian.
With the singular value decomposition

    A R diag(s) = U diag(s') Vᵀ

its axes are U and its scales s'. The pseudo-Gaussian of a DoG primitive has scales F s along the same axes. Where F is
the same along the axes, it stays so and nothing is lost. Otherwise its covariance Σ₂' = A R diag(F s)² Rᵀ Aᵀ need not
have the axes U, and a DoG primitive has no others: F' s' are the standard deviations of Σ₂' along U. No other F' is as
near, neither by the sum of squares of the covariance's entries nor by the Kullback-Leibler divergence.

What was seen along a direction d is seen along A d / |A d| afterwards. That is no polynomial in the direction any more:
coefficients of spherical harmonics become those of the nearest function of the same degree, in the mean of squares over
all directions. So do places that depend on the view, which are linear in it. docs/transforms.md has how near.
"""

from __future__ import annotations

import numpy as np

from .quaternions import quaternion_from_rotation, rotation_from_quaternion
from .row_groups import Array
from .sh_basis import sh_basis_table

POLAR, AROUND = 64, 128  # directions of the quadrature: exact to rounding up to ratios of 10 to 1
LEAST = 1e-36  # scale that is told from nothing
FLATTEST = 1e-7  # smallest over largest singular value of a map that can be undone in float32


def check_regular(linear: Array) -> None:
    """Raise ``ValueError`` for a [3, 3] map that flattens, or has values that are not finite."""
    if np.isfinite(linear).all():
        sizes = np.linalg.svd(linear, compute_uv=False)
        if sizes[-1] > FLATTEST * sizes[0]:
            return
    problem = "a model cannot be flattened: this matrix collapses it, or is not finite"
    raise ValueError(f"{problem}; give it finite numbers, and a scale along each axis that is not 0")


def mapped_kernels(linear: Array, quats: Array, scales: Array) -> tuple[Array, Array]:
    """(quaternions [N, 4] x, y, z, w, scales [N, 3]) of the Gaussians after a regular map [3, 3].

    Scales of Gaussians whose own are not finite become NaN.
    """
    if not len(quats):
        return quats, scales
    return kernels_of(linear @ rotation_from_quaternion(quats) * scales[:, None])


def kernels_of(columns: Array) -> tuple[Array, Array]:
    """(quaternions [N, 4] x, y, z, w, scales [N, 3]) of Gaussians with the covariances M Mᵀ of ``columns`` M [N, 3, 3].

    Scales of those that are not finite become NaN.
    """
    finite = np.isfinite(np.abs(columns).sum(axis=(1, 2)))[:, None]
    u, mapped, _ = np.linalg.svd(np.where(finite[..., None], columns, 0))
    u = u * np.where(np.linalg.det(u) < 0, -1.0, 1.0)[:, None, None]  # a rotation, no reflection: Σ' is the same
    mapped = np.where(finite, np.maximum(mapped, LEAST), np.nan)
    return quaternion_from_rotation(u), mapped


def mapped_factors(linear: Array, before: tuple[Array, Array], after: tuple[Array, Array], factors: Array) -> Array:
    """F' [N, 3] of DoG primitives with F [N, 3], whose (quaternions, scales) were and are these."""
    (quats, scales), (new_quats, new_scales) = before, after
    if not len(quats):
        return factors
    pseudo = linear @ rotation_from_quaternion(quats) * (factors * scales)[:, None]
    along = rotation_from_quaternion(new_quats).swapaxes(1, 2) @ pseudo  # [N, 3, 3]: rows are the new axes
    return np.linalg.norm(along, axis=2) / new_scales


def mapped_axes(linear: Array, before: tuple[Array, Array], after: tuple[Array, Array], values: Array) -> Array:
    """What is told by the axes of primitives whose (quaternions, scales) were and are these: slopes of colours
    [M, 3, channel] or normals of cuts [M, 3].

    A point that is w standard deviations along the old axes is S'⁻¹ R'ᵀ A R S w along the new ones. This matrix is
    orthogonal, and so it takes slopes and normals along, too: nothing is lost. Those of kernels that are not finite
    become NaN.
    """
    with np.errstate(invalid="ignore"):
        return np.einsum("mba,ma...->mb...", turns_of_axes(linear, before, after), values.astype(np.float64))


def turns_of_axes(linear: Array, before: tuple[Array, Array], after: tuple[Array, Array]) -> Array:
    """S'⁻¹ R'ᵀ A R S [M, 3, 3] of the same primitives."""
    (quats, scales), (new_quats, new_scales) = before, after
    if not len(quats):
        return np.zeros((0, 3, 3))
    columns = linear @ rotation_from_quaternion(quats) * scales[:, None]
    with np.errstate(invalid="ignore"):
        return rotation_from_quaternion(new_quats).swapaxes(1, 2) @ columns / new_scales[:, :, None]


def sh_projection(linear: Array, degree: int) -> Array:
    """Matrix [K, K] from the coefficients of f to those nearest to d ↦ f(A⁻¹ d / |A⁻¹ d|).

    The first rows and columns are the matrix of the lower degree: a projection does not depend on what else there is.
    """
    directions, weights, back = _sphere(linear)
    return (sh_basis_table(directions, degree) * weights[:, None]).T @ sh_basis_table(back, degree)


def view_projection(linear: Array) -> Array:
    """Matrix [3, 3] that takes a unit vector d nearest to A⁻¹ d / |A⁻¹ d|, in the mean of squares over all of them."""
    directions, weights, back = _sphere(linear)
    return 3 / (4 * np.pi) * (back * weights[:, None]).T @ directions


def _sphere(linear: Array) -> tuple[Array, Array, Array]:
    """A quadrature over directions d [D, 3]: (these, their weights [D], A⁻¹ d / |A⁻¹ d|)."""
    heights, weights = np.polynomial.legendre.leggauss(POLAR)
    angles = np.arange(AROUND) * 2 * np.pi / AROUND
    z, angle = (grid.ravel() for grid in np.meshgrid(heights, angles, indexing="ij"))
    radius = np.sqrt(1 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    back = directions @ np.linalg.inv(linear).T
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    return directions, np.repeat(weights * 2 * np.pi / AROUND, AROUND), back

