"""``dogsplat``, ``volprim_rf_basic`` and everything in between, in float64 NumPy, at chosen pixels.

The two renderers blend the same Gaussians by different rules. Each rule is a switch here, so that what it does to the
picture can be measured alone; with every switch on one side the model is that renderer, which the tests check.

A ray is o + t d with |d| = 1. A primitive with the centre μ, the rotation R and the scales s takes a ray into its own
frame, o' = S⁻¹ Rᵀ (o - μ), d' = S⁻¹ Rᵀ d. There the Gaussian is exp(-|p|² / 2); its peak on the line is at distance
|o' x d'| / |d'| from the centre, and its shell is the sphere of radius ``extent``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mi_dogsplat.plugin.ellipsoids import EXTENT
from mi_dogsplat.reference.forward import MAX_ALPHA, MIN_T
from mi_dogsplat.reference.projection import LOW_PASS, MIN_ALPHA, Projection, project, sh_basis
from mi_dogsplat.reference.quaternions import rotations
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats

RESTART = 1e-4  # how far behind an intersection ``volprim_rf_basic`` goes on
MAX_DEPTH = 64  # hits of a ray, unless ``volprim_rf_basic`` is told otherwise
NEAR_CLIP = 0.2  # of ``dogsplat``, in all these scenes
SENSOR_NEAR = 0.01  # near plane of the sensors that ``camera_to_mitsuba`` makes
BATCH = 4_000_000  # entries of the arrays [pixels, primitives] that are alive at once


@dataclass(frozen=True)
class Rules:
    """False is the rule of ``dogsplat``, True that of ``volprim_rf_basic``."""

    no_low_pass: bool = False  # 0.3 px² are not added to a projected covariance (on the ray there is none)
    peak_on_ray: bool = False  # the largest value on the ray, instead of the projected (EWA) kernel
    color_of_ray: bool = False  # spherical harmonics in the direction of the ray, instead of that of the centre
    entry_order: bool = False  # nearest shell first, misses what is less than 1e-4 behind; instead of nearest centre
    shell: bool = False  # nothing outside of the shell and α up to .9999, instead of nothing below 1/255 and up to .99
    inside_is_lost: bool = False  # a shell around the camera has no entry, instead of a near clip of the centre
    early_stop: bool = False  # once T <= .01 or after 64 hits, instead of before T < .0001


DOGSPLAT = Rules()
VOLPRIM = Rules(*[True] * 7)


def render_points(splats: Splats, camera: Camera, pixels: np.ndarray, rules: Rules) -> np.ndarray:
    """Blended colours [P, 3] over black at the points ``pixels`` [P, 2] of the image, of a model without DoG."""
    assert splats.n_dog == 0
    size = max(1, BATCH // max(1, splats.n_splats))
    parts = [_batch(splats, camera, pixels[k : k + size], rules) for k in range(0, len(pixels), size)]
    return np.concatenate(parts)


def _batch(splats: Splats, camera: Camera, pixels: np.ndarray, rules: Rules) -> np.ndarray:
    projection = project(splats, camera, near_clip=0 if rules.inside_is_lost else NEAR_CLIP)
    directions = ray_directions(camera, pixels)  # [P, 3]
    peak, miss, stretch = _closest(splats, camera.position, directions)  # [P, N] each
    met = miss < EXTENT**2
    entry = peak - np.sqrt(np.maximum(EXTENT**2 - miss, 0)) / stretch

    if rules.peak_on_ray:
        alpha = splats.opacities.astype(np.float64) * np.exp(-0.5 * miss)
    else:
        alpha = _screen(projection, pixels, LOW_PASS if rules.no_low_pass else 0.0)
    if rules.shell:
        alpha = np.minimum(np.where(met, alpha, 0), 0.9999)
    else:
        alpha = np.where(alpha >= MIN_ALPHA, np.minimum(alpha, MAX_ALPHA), 0)
    there = np.broadcast_to(projection.visible, alpha.shape)
    if rules.inside_is_lost:
        start = SENSOR_NEAR / (directions @ camera.w2c[2, :3])  # [P] Mitsuba's rays start on its own near plane
        there = np.where(met, entry >= start[:, None], there)
    alpha = np.where(there, alpha, 0)

    key = entry if rules.entry_order else np.broadcast_to(projection.depths, alpha.shape)
    hits = int((alpha > 0).sum(1).max())
    order = np.argsort(np.where(alpha > 0, key, np.inf), axis=1, kind="stable")[:, :hits]  # [P, hits]
    alpha, entry = np.take_along_axis(alpha, order, 1), np.take_along_axis(entry, order, 1)
    if rules.color_of_ray:
        sh = splats.sh_coeffs.astype(np.float64)[order]  # [P, hits, K, 3]
        colors = np.maximum(np.einsum("pk,phkc->phc", sh_basis(directions, splats.sh_degree), sh) + 0.5, 0)
    else:
        colors = projection.colors[order]
    return _blend(alpha, entry, colors, rules)


def _blend(alpha: np.ndarray, entry: np.ndarray, colors: np.ndarray, rules: Rules) -> np.ndarray:
    """Front to back over hits in order: alpha [P, hits], entry [P, hits], colors [P, hits, 3] -> [P, 3]."""
    out, T = np.zeros((len(alpha), 3)), np.ones(len(alpha))
    walking, start = np.ones(len(alpha), bool), np.full(len(alpha), -np.inf)
    hits = np.zeros(len(alpha), int)
    for k in range(alpha.shape[1]):
        a = alpha[:, k]
        if rules.entry_order:
            a = np.where(entry[:, k] >= start, a, 0)
            start = np.where(a > 0, entry[:, k] + RESTART, start)
        if rules.early_stop:
            walking &= (T > 0.01) & (hits < MAX_DEPTH)
            hits += a > 0
        else:
            walking &= T * (1 - a) >= MIN_T
        weight = np.where(walking, a * T, 0)
        out += weight[:, None] * colors[:, k]
        T = np.where(walking, T * (1 - a), T)
    return out


def ray_directions(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """[P, 3] unit directions in the world through points of the image."""
    tangents = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    local = np.concatenate([tangents, np.ones((len(pixels), 1))], axis=1)
    return local / np.linalg.norm(local, axis=1, keepdims=True) @ camera.w2c[:3, :3]


def _closest(splats: Splats, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, ...]:
    """[P, N] t of the peak on the ray, its squared distance from the centre in standard deviations, and |d'|."""
    scales = np.exp(splats.log_scales.astype(np.float64))
    frames = rotations(splats.quats.astype(np.float64)).swapaxes(1, 2) / scales[:, :, None]  # [N, 3, 3] S⁻¹ Rᵀ
    o = np.einsum("nij,nj->ni", frames, origin - splats.means.astype(np.float64))  # [N, 3]
    d = np.einsum("nij,pj->pni", frames, directions)  # [P, N, 3]
    squared = (d * d).sum(2)
    t = -(o[None] * d).sum(2) / squared
    return t, ((o[None] + t[..., None] * d) ** 2).sum(2), np.sqrt(squared)


def entries(splats: Splats, camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """[P, N] how far along the rays through ``pixels`` [P, 2] the shells are entered; inf where they are not."""
    peak, miss, stretch = _closest(splats, camera.position, ray_directions(camera, pixels))
    entry = peak - np.sqrt(np.maximum(EXTENT**2 - miss, 0)) / stretch
    return np.where((miss < EXTENT**2) & (entry > 0), entry, np.inf)


def _screen(projection: Projection, pixels: np.ndarray, taken_off: float) -> np.ndarray:
    """[P, N] values of the projected kernels, ``taken_off`` px² less wide."""
    xx, xy, yy = projection.cov2d.T
    xx, yy = xx - taken_off, yy - taken_off
    det = xx * yy - xy * xy
    usable = (det > 1e-12 * np.maximum(xx * yy, 1e-300)) & projection.visible
    inv = np.where(usable, 1 / np.where(usable, det, 1), 0)
    dx = pixels[:, None, 0] - projection.means2d[None, :, 0]
    dy = pixels[:, None, 1] - projection.means2d[None, :, 1]
    power = 0.5 * inv * (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy)
    return np.where(usable, projection.opacities * np.exp(-power), 0)
