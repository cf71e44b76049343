"""Where training starts: primitives at the points of structure from motion, or at random where cameras look."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from .cameras import Camera
from .sh import C0
from .splats import Splats

INITIAL_OPACITY = 0.1
NEIGHBOURS = 3
MIN_DISTANCE = 1e-7  # world units, the recipe's floor for coincident points


def splats_from_points(points: np.ndarray, colors: np.ndarray, sh_degree: int) -> Splats:
    """Isotropic primitives as large as the distance to their neighbours (Kerbl et al. 2023, Sec. 5.1).

    Args:
        points: [P, 3] world space; points that are not finite are left out.
        colors: [P, 3] display-referred, 0..1.
        sh_degree: 0..3; the view-dependent part starts at zero.

    scale = sqrt(mean squared distance to the 3 nearest neighbours), opacity 0.1.
    """
    points, colors = np.asarray(points, np.float64), np.asarray(colors, np.float64)
    finite = np.isfinite(points).all(1) & np.isfinite(colors).all(1)
    points, colors = points[finite], colors[finite]
    n = len(points)
    scales = np.full(n, 1.0)
    if n > 1:
        distances = cKDTree(points).query(points, k=min(NEIGHBOURS + 1, n))[0][:, 1:]  # [P, <= 3], itself left out
        scales = np.maximum(np.sqrt(np.mean(distances**2, axis=1)), MIN_DISTANCE)
    sh_coeffs = np.zeros((n, (sh_degree + 1) ** 2, 3))
    sh_coeffs[:, 0] = (colors - 0.5) / C0
    return Splats(
        means=points,
        log_scales=np.log(scales)[:, None].repeat(3, axis=1),
        quats=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        logit_opacities=np.full(n, np.log(INITIAL_OPACITY / (1 - INITIAL_OPACITY))),
        sh_coeffs=sh_coeffs,
    )


def point_of_interest(cameras: Sequence[Camera]) -> np.ndarray:
    """[3] point nearest to all optical axes in the least-squares sense; well defined for parallel axes too."""
    directions = np.array([camera.w2c[2, :3] for camera in cameras])  # [V, 3] viewing directions
    positions = np.array([camera.position for camera in cameras])
    normal = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # [V, 3, 3] removes the part along the axis
    A, b = normal.sum(0), np.einsum("vij,vj->i", normal, positions)
    # a slight pull to the mean camera keeps parallel axes solvable
    pull = 1e-6 * len(cameras)
    return np.linalg.solve(A + pull * np.eye(3), b + pull * positions.mean(0))


def random_splats(cameras: Sequence[Camera], count: int, rng: np.random.Generator, sh_degree: int) -> Splats:
    """``count`` primitives where at least half of the cameras look, colours random.

    Candidates fill a cube around the point of interest whose half side is the median distance of the cameras from it, or,
    where the views have no common region (a forward-facing or outward-looking capture), whatever any camera sees.
    """
    centre = point_of_interest(cameras)
    radius = float(np.median([np.linalg.norm(camera.position - centre) for camera in cameras])) or 1.0
    candidates = centre + radius * rng.uniform(-1, 1, (20 * count, 3))
    seen = np.zeros(len(candidates))
    for camera in cameras:
        pixels, depth = camera.project(candidates)
        with np.errstate(invalid="ignore"):
            inside = (pixels >= 0).all(1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
        seen += inside & (depth > 0.05 * radius)
    for quorum in (0.5 * len(cameras), 1, 0):
        chosen = candidates[seen >= quorum][:count]
        if len(chosen) == count:
            break
    return splats_from_points(chosen, rng.uniform(0, 1, (count, 3)), sh_degree)
