"""Linear transforms of a model: positions, orientations, sizes and the directions of its spherical harmonics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .linear_map import check_regular, mapped
from .model import ALONG_AXES, SHIFTS, Model, normalized
from .rotation import quaternion_from_rotation, quaternion_product
from .sh import sh_rotation


def transformed(model: Model, matrix: np.ndarray) -> Model:
    """The model moved by a [4, 4] matrix; the very same model for the identity.

    Similarities and mirror images are exact; ``linear_map.py`` has what becomes of the others. Raises ``ValueError``
    for a matrix that flattens.
    """
    matrix = np.asarray(matrix, np.float64)
    if np.abs(matrix - np.eye(4)).max() < 1e-7:
        return model
    linear = matrix[:3, :3]
    check_regular(linear)
    scale, means = mean_scale(linear), (model.means.astype(np.float64) @ linear.T + matrix[:3, 3]).astype(np.float32)
    if np.abs(linear @ linear.T - scale**2 * np.eye(3)).max() > 1e-4 * scale**2:
        return replace(mapped(model, linear), means=means)
    isometry = linear / scale
    turn = sh_rotation(isometry, model.sh_degree)
    turns = np.linalg.det(isometry) > 0
    rotation = isometry if turns else -isometry  # the same of a kernel, which is symmetric; its axes are turned round
    quats = quaternion_product(quaternion_from_rotation(rotation), normalized(model.quats).astype(np.float64))
    return replace(
        model,
        means=means,
        log_scales=(model.log_scales + np.log(scale)).astype(np.float32),
        quats=quats.astype(np.float32),
        sh_coeffs=np.einsum("ij,njc->nic", turn, model.sh_coeffs.astype(np.float64)).astype(np.float32),
        **({} if turns else _turned_round(model)),
    )


def _turned_round(model: Model) -> dict[str, np.ndarray]:
    """What is told along axes that all point the other way now; a move and its view both do, so their matrix stays."""
    views = np.concatenate([model.shifts[:, :3], -model.shifts[:, 3:]], axis=1)
    return {SHIFTS.values: views} | {group.values: -getattr(model, group.values) for group in ALONG_AXES}


def mean_scale(linear: np.ndarray) -> float:
    """The factor of a [3, 3] map on lengths: of a similarity its scale, else the geometric mean along three axes."""
    return float(np.cbrt(abs(np.linalg.det(linear))))
