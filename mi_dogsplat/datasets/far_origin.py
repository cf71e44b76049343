"""Captures whose poses are in coordinates of the earth, as drones and surveys have them: their cameras are near to each
other and millions of units from the origin, and models hold places in single precision."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .colmap import find_model, read_poses
from .transforms import find_transforms, read_frame_positions

COARSEST = 1e-4  # of the spread of the cameras: a tenth of a pixel of a picture of a thousand


def far_from_origin(path: Path) -> list[str]:
    """A line on a data set whose scene single precision cannot hold in detail where it is; none of others. Raises
    ``DataError``."""
    positions = _positions(path).astype(np.float64)  # [V, 3]
    if len(positions) < 2 or not np.isfinite(positions).all():
        return []
    middle = positions.mean(axis=0)
    spread = float(np.linalg.norm(positions - middle, axis=1).max())
    furthest = float(np.abs(middle).max())
    step = float(np.spacing(np.float32(min(furthest, 1e38))))
    if not spread or step <= COARSEST * spread:
        return []
    where = f"its cameras are spread over {2 * spread:.3g} units, {furthest:.3g} units from the origin"
    problem = f"where a model cannot tell places apart that are nearer than {step:.2g}"
    return [f"{where}, {problem}: subtract their mean position from poses and points first"]


def _positions(path: Path) -> np.ndarray:
    """Camera centres [V, 3] of a data set in files; [0, 3] of others."""
    model = find_model(path) if path.is_dir() else None
    if model:
        return np.array([c2w[:3, 3] for c2w in read_poses(model).values()]).reshape(-1, 3)
    file = find_transforms(path) if path.is_dir() else path if path.suffix == ".json" and path.is_file() else None
    return read_frame_positions(file) if file else np.zeros((0, 3))
