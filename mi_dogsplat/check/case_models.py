"""What the stability cases are made of: primitives of all kinds, ordinary ones around them, and a camera."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..scene.cameras import Camera, affine
from ..scene.quaternions import rotation_from_quaternion
from ..scene.row_groups import OWN_AXES, SHIFTS
from ..scene.sh_basis import C0
from ..scene.shifts import mean_views
from ..scene.splats import Splats

WIDTH, HEIGHT, FOCAL = 48, 40, 45.0
SCALES = (0.2, 0.3, 0.45)
SLOPES_OF_ONE = 0.4 * np.sin(1 + np.arange(9)).reshape(3, 3)
CURVATURES_OF_ONE = 0.3 * np.cos(1 + np.arange(6))
NORMAL_OF_ONE, SECOND_NORMAL_OF_ONE = np.array([-3.0, 4, 2]), np.array([4.0, 2, -3])
SHIFTS_OF_ONE, VIEW_OF_ONE = 0.5 * np.sin(2 + np.arange(9)).reshape(3, 3), np.array([0.3, -0.4, 0.5])
_K = np.array([[0, -0.1, -0.2], [0.1, 0, -0.3], [0.2, 0.3, 0]])
TURN = np.linalg.solve(np.eye(3) - _K, np.eye(3) + _K)  # world to camera, a rotation (Cayley)


def camera(width: int = WIDTH, height: int = HEIGHT, focal: float = FOCAL, centre: Any = (0, 0, 0)) -> Camera:
    """Looks along +z from ``centre``, a little turned, so that no number is zero by chance."""
    w2c = affine(TURN, -TURN @ np.asarray(centre, float))
    return Camera(w2c, focal, 1.05 * focal, 0.48 * width, 0.53 * height, width, height)


def primitives(
    means: Any, scales: Any = SCALES, opacity: Any = 0.6, quats: Any = (0.3, -0.2, 0.5, 0.8),
    color: Any = (0.9, 0.5, 0.2), logits: Any = None, dog: bool = False, f_a: Any = 0.5, F: Any = 1.6,
    log_scales: Any = None, slopes: Any = None, curvatures: Any = None, normals: Any = None,
    second_normals: Any = None, shifts: Any = None, mean_view: Any = VIEW_OF_ONE,
) -> Splats:  # fmt: skip
    """One primitive per row of ``means`` (camera space of ``camera()``), SH degree 1; scalars are spread."""
    means = np.asarray(means, float).reshape(-1, 3) @ TURN
    n = len(means)
    sh = np.zeros((n, 4, 3))
    sh[:, 0] = (np.broadcast_to(np.asarray(color, float), (n, 3)) - 0.5) / C0
    sh[:, 1:] = 0.1 * np.cos(np.arange(9)).reshape(3, 3)
    opacity, f_a = np.broadcast_to(opacity, n), np.broadcast_to(f_a, n)
    with np.errstate(divide="ignore"):
        logits = np.log(opacity) - np.log1p(-opacity) if logits is None else np.broadcast_to(logits, n)
        log_scales = np.log(np.broadcast_to(scales, (n, 3))) if log_scales is None else log_scales
        dog_part = {
            "dog_index": np.arange(n),
            "dog_logit_opacities": np.log(f_a) - np.log1p(-f_a),
            "dog_log_scales": np.log(np.broadcast_to(F, (n, 3))),
        }
    return Splats(
        means=means, log_scales=np.broadcast_to(log_scales, (n, 3)), quats=np.broadcast_to(quats, (n, 4)),
        logit_opacities=logits, sh_coeffs=sh, **(dog_part if dog else {}),
        **_own_axes(np.arange(n), slopes, curvatures, normals, second_normals),
        **_shifts(np.arange(n), shifts, mean_view),
    )  # fmt: skip


def _own_axes(index: np.ndarray, *given: Any) -> dict[str, np.ndarray]:
    """What is told along the axes of the primitives ``index``, where it is given; in the order of ``OWN_AXES``."""
    found: dict[str, np.ndarray] = {}
    for group, values in zip(OWN_AXES, given, strict=True):
        ((name, row),) = group.arrays.items()
        if values is not None:
            found |= {group.index: index, name: np.broadcast_to(values, (len(index), *row))}
    return found


def own_views(splats: Splats) -> np.ndarray:
    """[N, 3] from where ``camera()`` sees the primitives, along their own axes."""
    return mean_views(splats.means, splats.quats, camera().position[None])


def moved(splats: Splats, way: Any) -> Splats:
    """All primitives with the least shifts by which ``camera()`` sees them moved by ``way``, in its space."""
    n, turned = splats.n_splats, np.asarray(way, float) @ TURN
    views = own_views(splats) - VIEW_OF_ONE
    ways = np.einsum("nxa,x->na", rotation_from_quaternion(splats.quats), turned) / splats.scales
    shifts = ways[:, :, None] * (views / (views**2).sum(axis=1, keepdims=True))[:, None]
    return replace(splats, **_shifts(np.arange(n), shifts, VIEW_OF_ONE))


def _shifts(index: np.ndarray, shifts: Any, mean_view: Any) -> dict[str, np.ndarray]:
    """Those of the primitives ``index``, where there are some."""
    if shifts is None:
        return {}
    values = zip(SHIFTS.arrays.items(), (shifts, mean_view), strict=True)
    rows = {name: np.broadcast_to(value, (len(index), *row)) for (name, row), value in values}
    return {SHIFTS.index: index, **rows}


def bystanders(
    slopes: Any = None, curvatures: Any = None, normals: Any = None, second_normals: Any = None, shifts: Any = None
) -> Splats:
    """Twelve ordinary primitives around a distance of 4, three of them DoG; ``slopes`` and ``shifts`` [3, 3],
    ``curvatures`` [6] and normals [3] are those of six."""
    rng = np.random.default_rng(7)
    means = rng.uniform([-1.6, -1.3, 0.7], [1.6, 1.3, 1.6], (12, 3)) * (1, 1, 4)
    scales = 0.25 * np.exp(rng.normal(0, 0.4, (12, 3)))
    color, quats = rng.uniform(0.1, 1, (12, 3)), rng.normal(size=(12, 4))
    plain = primitives(means[:9], scales[:9], rng.uniform(0.2, 0.9, 9), quats[:9], color[:9])
    splats = plain.joined(primitives(means[9:], scales[9:], 0.7, quats[9:], color[9:], dog=True))
    six = np.arange(0, 12, 2)
    rows = _own_axes(six, slopes, curvatures, normals, second_normals) | _shifts(six, shifts, VIEW_OF_ONE)
    return replace(splats, **rows)
