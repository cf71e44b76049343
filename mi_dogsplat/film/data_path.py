"""The way that a photographer went, without the trembling: the cameras of a data set in order, smoothed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from ..scene.cameras import Camera, affine
from ..support.wording import counted
from .camera_path import CameraPath, Lens, focal_of_camera, focal_of_fov
from .film_config import FilmConfig
from .splines import rotation_curve, vector_curve

DETOUR = 2.0  # the order of the names is that of the photographer unless it makes the way so much longer
REACH = 4.0  # standard deviations of smoothing
ROWS = 1024  # of positions, whose distances from all others are looked at together
SWEEPS = 20  # of a tour, each of which tries to reverse every part of it


def cameras_path(cameras: Sequence[Camera], config: FilmConfig) -> CameraPath:
    """A path along cameras that are given in the order of their names, at an even pace."""
    order = walk(steps_between(cameras))
    ordered = [cameras[i] for i in order]
    positions = np.array([camera.position for camera in ordered])  # [V, 3]
    rotations = np.array([camera.c2w[:3, :3] for camera in ordered])  # [V, 3, 3]
    focals = np.log([focal_of_camera(camera) for camera in ordered])  # [V]
    if config.smoothing:
        positions, rotations, focals = _smoothed(positions, rotations, focals, config.smoothing)
    lengths = steps_along(positions, rotations)
    lengths = lengths + abs(np.diff(focals))  # a zoom takes its time too: at one place its curve would swing far beyond
    moving = np.concatenate([[True], lengths > 1e-9])  # cameras at one place are one key
    times = np.concatenate([[0.0], np.cumsum(lengths)])[moving]
    end = times[-1] or 1.0
    places = vector_curve(times / end, positions[moving])
    turns = rotation_curve(times / end, rotations[moving])
    zooms = vector_curve(times / end, focals[moving, None])

    def at(share: float) -> Lens:
        focal = float(np.exp(zooms(share)[0])) if config.fov is None else focal_of_fov(config.fov)
        return Lens(affine(turns(share), places(share)), focal)

    first = ordered[0]
    return CameraPath(at, False, f"along {counted(len(cameras), 'camera')}", size=(first.width, first.height))


def steps_between(cameras: Sequence[Camera]) -> np.ndarray:
    """``steps_between_poses`` of cameras, [V, V]."""
    rotations = np.array([camera.c2w[:3, :3] for camera in cameras])  # [V, 3, 3]
    return steps_between_poses(np.array([camera.position for camera in cameras]), rotations)


def steps_between_poses(positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """How far poses, [V, 3] and [V, 3, 3], are from each other, [V, V]: distance over the largest one, plus radians."""
    steps = cdist(positions, positions)  # [V, V], as all that follows: a survey from the air has ten thousand cameras
    steps /= steps.max() or 1.0
    angles = _angles(rotations.reshape(-1, 9) @ rotations.reshape(-1, 9).T)
    angles[np.arange(len(angles)), np.arange(len(angles))] = 0
    steps += angles
    return steps


def steps_along(positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """``steps_between_poses`` from each to the next, [V - 1]."""
    largest = max(float(cdist(positions[k : k + ROWS], positions).max()) for k in range(0, len(positions), ROWS))
    distances = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return distances / (largest or 1.0) + _angles((rotations[1:] * rotations[:-1]).sum((1, 2)))


def _angles(traces: np.ndarray) -> np.ndarray:
    """Of rotations, in radians, from the traces of their matrices, whose place they take."""
    traces -= 1
    traces /= 2
    return np.arccos(np.clip(traces, -1, 1, out=traces), out=traces)


def walk(steps: np.ndarray) -> np.ndarray:
    """An order [V] in which to visit what is ``steps`` [V, V] apart: as given, or a far shorter one if there is one.

    Photographs of a walk are named in its order; those of a scattered capture are not. The other order is a tour from
    neighbour to neighbour, improved by reversing parts of it (2-opt; Croes 1958). It is not looked for where none can
    be so short: from all but the last one a tour goes at least as far as to the nearest other one.
    """
    given = np.arange(len(steps))
    if _length(given, steps) <= DETOUR * _least(steps):
        return given
    tour = _without_crossings(_from_neighbour_to_neighbour(steps), steps)
    return tour if _length(tour, steps) * DETOUR < _length(given, steps) else given


def _least(steps: np.ndarray) -> float:
    """A length that no tour is below."""
    nearest = np.array([np.delete(row, i).min(initial=np.inf) for i, row in enumerate(steps)])
    return float(nearest.sum() - nearest.max()) if len(steps) > 1 else 0.0


def _from_neighbour_to_neighbour(steps: np.ndarray) -> np.ndarray:
    left = np.ones(len(steps), bool)
    order = [0]
    for _ in range(len(steps) - 1):
        left[order[-1]] = False
        order.append(int(np.argmin(np.where(left, steps[order[-1]], np.inf))))
    return np.array(order)


def _without_crossings(order: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """The order after reversing every part whose reversal makes it shorter; its first one stays."""
    n = len(order)
    for _ in range(SWEEPS):
        before = _length(order, steps)
        for i in range(1, n - 1):
            ends = np.arange(i + 1, n)
            a, b, c = order[i - 1], order[i], order[ends]
            after = np.append(order[i + 2 :], -1)  # of each end; the last has none
            leaving = np.where(after >= 0, steps[c, after], 0)
            arriving = np.where(after >= 0, steps[b, after], 0)
            gains = steps[a, b] + leaving - steps[a, c] - arriving
            best = int(np.argmax(gains))
            if gains[best] > 1e-12:
                order[i : ends[best] + 1] = order[i : ends[best] + 1][::-1].copy()
        if _length(order, steps) > before - 1e-9:
            break
    return order


def _length(order: np.ndarray, steps: np.ndarray) -> float:
    return float(steps[order[:-1], order[1:]].sum())


def _smoothed(
    positions: np.ndarray, rotations: np.ndarray, focals: np.ndarray, deviation: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gaussian means over neighbours in the order; rotations in the sense of Markley et al. 2007."""
    turns, n, reach = Rotation.from_matrix(rotations), len(positions), int(REACH * deviation)
    smoothed = []
    for i in range(n):
        near = slice(max(0, i - reach), min(n, i + reach + 1))
        weights = np.exp(-0.5 * ((np.arange(n)[near] - i) / deviation) ** 2)
        weights /= weights.sum()
        smoothed.append((weights @ positions[near], turns[near].mean(weights).as_matrix(), weights @ focals[near]))
    places, turned, zooms = map(np.array, zip(*smoothed, strict=True))
    return places, turned, zooms
