"""How well up and lengths are found in a capture whose exact cameras are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.lengths import length_in_units, standpoints_of
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.orientation import up_vector
from mi_dogsplat.support.errors import DataError

from .pose_error import alignment

PAIRS = 60  # of points between which lengths are measured
CLICK = 1.0  # pixel: standard deviation of a person's marks


@dataclass(frozen=True)
class WorldError:
    """``up`` in degrees; lengths as the median of |relative error|, by points marked in one image and in two;
    ``refused``: share of the pairs marked in one image whose depth is not told."""

    up: float
    one_mark: float
    two_marks: float
    refused: float


def world_error(exact: Mapping[str, Camera], posed: Path) -> WorldError:
    """Of a folder of poses whose up is -y, against cameras by the names of views, in a world whose up is z.

    Points are those of structure from motion, where the exact cameras have them; marks are off by a pixel.
    """
    dataset = load_dataset(posed, on_disk=True)
    found = {view.name: view.camera for view in dataset.views}
    similar = alignment(exact, found)
    angle = np.degrees(np.arccos(np.clip(similar.rotation @ (0, -1, 0) @ up_vector("z"), -1, 1)))
    standpoints, rng = standpoints_of(dataset), np.random.default_rng(0)
    points = similar.points(dataset.points.astype(np.float64))
    names, errors, refused = sorted(dataset.observations), {1: [], 2: []}, 0
    for _ in range(PAIRS):
        first = names[rng.integers(len(names))]
        away = sorted(names, key=lambda name: -np.linalg.norm(exact[name].position - exact[first].position))
        a, b = points[rng.choice(dataset.observations[first].points, 2, replace=False)]
        second = next((n for n in away[len(away) // 2 :] if _sees(exact[n], a, b)), None)
        if second is None:
            continue
        truth = float(np.linalg.norm(a - b)) / similar.scale
        one = _mark(exact[first], first, a, rng), _mark(exact[first], first, b, rng)
        again = _mark(exact[second], second, a, rng), _mark(exact[second], second, b, rng)
        two = f"{one[0]}+{again[0]}", f"{one[1]}+{again[1]}"
        for n, ends in ((1, one), (2, two)):
            try:
                errors[n].append(abs(length_in_units(ends, standpoints) / truth - 1))
            except DataError:
                refused += n == 1
    shares = {n: float(np.median(values)) for n, values in errors.items()}
    return WorldError(float(angle), shares[1], shares[2], refused / max(1, refused + len(errors[1])))


def _sees(camera: Camera, *points: np.ndarray) -> bool:
    pixels, depths = camera.project(np.array(points))
    return bool((depths > 0).all() and (pixels >= 0).all() and (pixels < (camera.width, camera.height)).all())


def _mark(camera: Camera, name: str, point: np.ndarray, rng: np.random.Generator) -> str:
    """The point as a person marks it; the exact cameras have no lens, and the film none either."""
    x, y = camera.project(point[None])[0][0] + CLICK * rng.normal(size=2)
    return f"{name}:{max(x, 0):.1f},{max(y, 0):.1f}"
