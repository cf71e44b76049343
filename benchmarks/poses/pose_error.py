"""How far the poses that were found are from the exact ones, after the similarity that fits best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from mi_dogsplat.scene.cameras import Camera


@dataclass(frozen=True)
class Similarity:
    """x to ``scale`` * ``rotation`` [3, 3] x + ``shift`` [3]."""

    scale: float
    rotation: np.ndarray
    shift: np.ndarray

    def points(self, points: np.ndarray) -> np.ndarray:
        """[P, 3]"""
        return self.scale * points @ self.rotation.T + self.shift


@dataclass(frozen=True)
class PoseError:
    """Over the ``n`` cameras that have both poses; positions in units of the largest distance of an exact camera from
    the mean one, angles in degrees, after the rotation that fits the orientations best; ``focal``: found over exact."""

    n: int
    position: float  # root mean square
    largest_position: float
    angle: float  # median
    focal: float  # median


def alignment(exact: Mapping[str, Camera], found: Mapping[str, Camera]) -> Similarity:
    """From the world that was found to the exact one, by the centres of the cameras (Umeyama 1991)."""
    names = sorted(set(exact) & set(found))
    a, b = (np.array([cameras[name].position for name in names]) for cameras in (exact, found))  # [N, 3]
    away, from_mean = a - a.mean(axis=0), b - b.mean(axis=0)
    rotation, spread = _nearest_rotation(away.T @ from_mean)
    scale = float(spread / (from_mean**2).sum())
    return Similarity(scale, rotation, a.mean(axis=0) - scale * rotation @ b.mean(axis=0))


def pose_error(exact: Mapping[str, Camera], found: Mapping[str, Camera]) -> PoseError:
    """Cameras by the names of their views."""
    names = sorted(set(exact) & set(found))
    a, b = (np.array([cameras[name].position for name in names]) for cameras in (exact, found))  # [N, 3]
    distances = np.linalg.norm(alignment(exact, found).points(b) - a, axis=1)  # [N]
    extent = float(np.linalg.norm(a - a.mean(axis=0), axis=1).max())
    turns = [exact[name].c2w[:3, :3] @ found[name].c2w[:3, :3].T for name in names]
    rotation, _ = _nearest_rotation(np.sum(turns, axis=0))
    angles = [np.degrees(np.arccos(np.clip((np.trace(rotation.T @ turn) - 1) / 2, -1, 1))) for turn in turns]
    focal = float(np.median([found[name].fx / exact[name].fx for name in names]))
    rms = float(np.sqrt((distances**2).mean()))
    return PoseError(len(names), rms / extent, float(distances.max()) / extent, float(np.median(angles)), focal)


def _nearest_rotation(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    """(the rotation R [3, 3] with the largest trace of Rᵀ ``matrix``, that trace)"""
    U, values, Vt = np.linalg.svd(matrix)
    signs = np.array([1, 1, np.linalg.det(U @ Vt)])
    return U * signs @ Vt, float((values * signs).sum())
