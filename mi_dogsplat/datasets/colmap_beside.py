"""Sparse points of the COLMAP model that a ``transforms.json`` was made of, in the frame of its poses.

Converters move them: that of nerfstudio turns the axes (``applied_transform`` says how, in files of later versions),
that of instant-ngp also sets the scene upright, in the middle and to a scale. The poses of the same images tell how.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..scene.cameras import affine
from .colmap import find_model, read_model_points, read_poses
from .dataset import no_points
from .point_colors import in_srgb
from .view_images import ViewSource

TOLERANCE = 1e-3  # of the spread of the cameras, and of a rotation


def points_beside(folder: Path, sources: Sequence[ViewSource]) -> tuple[np.ndarray, np.ndarray]:
    """Points [P, 3] and sRGB colours [P, 3] of the COLMAP model in a folder, in the frame of the cameras of
    ``sources``; none where there is no model, or its cameras are others. Raises ``DataError``."""
    model = find_model(folder)
    if model is None:
        return no_points()
    theirs = read_poses(model)
    pairs = [(source.camera.c2w, theirs[source.name]) for source in sources if source.name in theirs]
    placement = _placement(*np.array(pairs).transpose(1, 0, 2, 3)) if pairs else None
    if placement is None:
        return no_points()
    points = read_model_points(model)
    placed = points.positions @ placement[:3, :3].T + placement[:3, 3]
    return placed.astype(np.float32), in_srgb(points.colors, [source.image_path for source in sources])


def _placement(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray | None:
    """The similarity [4, 4] that takes camera-to-world matrices [V, 4, 4] to ours; None where there is none.

    The rotation is the nearest to all that single cameras tell (Kabsch), so that cameras along a line are enough; the
    scale is then that of least squares. Cameras at one place tell none.
    """
    spread = np.linalg.norm(ours[:, :3, 3] - ours[:, :3, 3].mean(axis=0), axis=1).max()
    if np.abs(ours[:, :3, 3] - theirs[:, :3, 3]).max() <= TOLERANCE * spread:
        return np.eye(4)
    u, _, vt = np.linalg.svd(np.einsum("vij,vkj->ik", ours[:, :3, :3], theirs[:, :3, :3]))
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    middle, their_middle = ours[:, :3, 3].mean(axis=0), theirs[:, :3, 3].mean(axis=0)
    from_middle, turned = ours[:, :3, 3] - middle, (theirs[:, :3, 3] - their_middle) @ rotation.T  # [V, 3]
    scale = (from_middle * turned).sum() / np.square(turned).sum() if turned.any() else 0.0
    off = np.abs(from_middle - scale * turned).max()
    wrong = np.abs(ours[:, :3, :3] - rotation @ theirs[:, :3, :3]).max()
    if scale <= 0 or off > TOLERANCE * spread or wrong > TOLERANCE:
        return None
    return affine(scale * rotation, middle - scale * rotation @ their_middle)
