"""Linear transforms of a model: positions, orientations, sizes and the directions of its spherical harmonics.

Similarities, mirror images among them, are exact; ``linear_map.py`` has what becomes of the others.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..support.classes import require_class
from . import shifts
from .curvatures import turned
from .linear_map import (
    check_regular,
    mapped_axes,
    mapped_factors,
    mapped_kernels,
    sh_projection,
    turns_of_axes,
    view_projection,
)
from .quaternions import quaternion_from_rotation, quaternion_product, rotation_from_quaternion
from .row_groups import ALONG_AXES, REVERSED, SH
from .sh_basis import sh_basis_table
from .splats import Splats

AFFINE = 1e-5  # by which the last row of a matrix may be off


def decompose_similarity(matrix: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """(rotation or rotoreflection [3,3], scale, translation [3]) of a 4x4 matrix.

    Raises ``ValueError`` unless the matrix is such an isometry, a uniform positive scale and a translation, all finite.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    check_affine(matrix)
    linear, translation = matrix[:3, :3], matrix[:3, 3]
    if not np.isfinite(matrix).all():
        raise ValueError("a model cannot be moved: this matrix is not finite; correct it")
    check_regular(linear)
    scale = float(np.cbrt(abs(np.linalg.det(linear))))
    if not np.allclose(linear @ linear.T, scale**2 * np.eye(3), atol=1e-4 * scale**2):
        raise ValueError(
            "a model can be rotated, mirrored, scaled uniformly and translated here; this matrix shears or stretches "
            "it; load the shape with it, or give a rotation an axis of length 1"
        )
    return linear / scale, scale, translation


def check_affine(matrix: np.ndarray) -> None:
    """Raise ``ValueError`` unless the last row of a matrix [4, 4] is 0, 0, 0, 1, as far as float32 tells."""
    if not np.allclose(matrix[3], (0, 0, 0, 1), rtol=0, atol=AFFINE):
        row = ", ".join(f"{value:g}" for value in matrix[3])
        raise ValueError(f"a model cannot be projected: the last row of this matrix is {row}, not 0, 0, 0, 1")


def mean_scale(matrix: np.ndarray) -> float:
    """The factor of a matrix [4, 4] on lengths: of a similarity its scale, else the geometric mean along three axes."""
    return float(np.cbrt(abs(np.linalg.det(np.asarray(matrix, dtype=np.float64)[:3, :3]))))


def sh_rotation(rotation: np.ndarray, degree: int) -> np.ndarray:
    """Matrix [K, K] that takes SH coefficients of f to those of f∘R⁻¹, R a rotation or rotoreflection.

    Solved from samples: each band is a function space closed under both, so matching 2K directions is exact.
    """
    directions = np.random.default_rng(0).normal(size=(4 * (degree + 1) ** 2, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before, after = (sh_basis_table(d, degree) for d in (directions, directions @ rotation))  # rows: R⁻¹ d = d R
    return np.linalg.lstsq(before, after, rcond=None)[0]


def transformed(splats: Splats, matrix: np.ndarray) -> Splats:
    """The model moved by a matrix [4, 4], which maps its points as columns. Exactly the same arrays for the identity.

    Raises ``ValueError`` for what are no ``Splats``, what is no such matrix, and for one that collapses the model,
    projects it or is not finite.
    """
    require_class("transformed: what is moved", splats, Splats, "those of a Model are model.splats")
    matrix = _matrix(matrix)
    if np.array_equal(matrix, np.eye(4)):
        return splats
    check_affine(matrix)
    linear, translation = matrix[:3, :3], matrix[:3, 3]
    check_regular(linear)
    if not np.isfinite(translation).all():
        raise ValueError("a model cannot be moved: this translation is not finite; correct it")
    try:
        isometry, scale, _ = decompose_similarity(matrix)
    except ValueError:
        means = splats.means.astype(np.float64) @ linear.T + translation
        return replace(splats, means=means, **_mapped(splats, linear), **_projected(splats, linear))
    turn = sh_rotation(isometry, splats.sh_degree)

    def turned_bands(coeffs: np.ndarray, first: int) -> np.ndarray:
        """Rows of the coefficients from ``first`` on."""
        own = slice(first, first + coeffs.shape[1])
        return np.einsum("ij,njc->nic", turn[own, own], coeffs.astype(np.float64))

    groups = [group for group in SH.values() if len(getattr(splats, group.index))]
    of_groups = {name: turned_bands(getattr(splats, name), 1) for group in groups for name in group.names}
    turns = np.linalg.det(isometry) > 0
    rotation = isometry if turns else -isometry  # the same of a kernel, which is symmetric; its axes are turned round
    along_axes = {name: getattr(splats, name) * np.float32(1 if turns else -1) for name in REVERSED}
    return replace(
        splats,
        means=splats.means.astype(np.float64) @ (scale * isometry).T + translation,
        log_scales=splats.log_scales + np.log(scale),
        quats=quaternion_product(quaternion_from_rotation(rotation), _turning(splats.quats)),
        sh_coeffs=turned_bands(splats.sh_coeffs, 0),
        **along_axes,
        **of_groups,
    )


def _matrix(matrix: np.ndarray) -> np.ndarray:
    """As float64 [4, 4]."""
    try:
        found = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        kind, remedy = type(matrix).__name__, "that of a transform of Mitsuba is np.array(transform.matrix)"
        raise ValueError(f"transformed: {kind} is no matrix [4, 4]; {remedy}") from None
    if found.shape != (4, 4):
        raise ValueError(f"transformed: the matrix has shape {list(found.shape)}, expected [4, 4]")
    return found


def _turning(quats: np.ndarray) -> np.ndarray:
    """Quaternions [N, 4] that turn as those do in a product: zero, which is read as the identity, becomes it."""
    return np.where(quats.any(axis=1, keepdims=True), quats, (0, 0, 0, 1)).astype(np.float64)


def _mapped(splats: Splats, linear: np.ndarray) -> dict[str, Any]:
    """Kernels after a map that is no similarity."""
    with np.errstate(over="ignore"):  # what no file should hold becomes NaN
        before = splats.quats.astype(np.float64), np.exp(splats.log_scales.astype(np.float64))
    after = mapped_kernels(linear, *before)

    def of(index: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        return (before[0][index], before[1][index]), (after[0][index], after[1][index])

    factors = mapped_factors(linear, *of(splats.dog_index), splats.dog_scales.astype(np.float64))
    found = {"quats": after[0], "log_scales": np.log(after[1]), "dog_log_scales": np.log(factors)}
    for name, group in ALONG_AXES.items():
        found[name] = mapped_axes(linear, *of(getattr(splats, group.index)), getattr(splats, name))
    turn = turns_of_axes(linear, *of(splats.curvature_index))
    found["brightness_curvatures"] = turned(splats.brightness_curvatures, turn)
    if splats.n_shifts:
        old, new = (rotation_from_quaternion(kernels[0][splats.shift_index]) for kernels in (before, after))
        directions = old.swapaxes(1, 2) @ view_projection(linear) @ new
        moves = turns_of_axes(linear, *of(splats.shift_index))
        along, views = shifts.turned(splats.view_shifts, splats.mean_views, moves, directions)
        found |= {"view_shifts": along, "mean_views": views}
    return found


def _projected(splats: Splats, linear: np.ndarray) -> dict[str, Any]:
    """Colours after it: what a band loses goes into those below, the constant one among them."""
    project = sh_projection(linear, splats.sh_degree)
    k = splats.sh_coeffs.shape[1]
    constant = np.einsum("ij,njc->nic", project[:k, :k], splats.sh_coeffs.astype(np.float64))
    values = {"sh_coeffs": constant}
    for degree, group in SH.items():
        index, (name,) = getattr(splats, group.index), group.names
        if len(index):
            rows = project[: (degree + 1) ** 2, 1 : (degree + 1) ** 2]
            bands = np.einsum("ij,njc->nic", rows, getattr(splats, name).astype(np.float64))
            constant[index] += bands[:, :1]
            values[name] = bands[:, 1:]
    return values
