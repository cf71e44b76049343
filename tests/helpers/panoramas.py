"""Panoramas of the room of ``benchmarks/poses/filmed_scene.py``, and where they were taken."""

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.support.srgb import linear_to_srgb

WIDTH, N, SAMPLES = 640, 5, 4


def rays(width: int, rng: np.random.Generator) -> np.ndarray:
    """Directions [H * W, 3] of a jittered panorama: x right, y down, z ahead."""
    height = width // 2
    jitter = rng.random((2, height, width))
    longitude = ((np.arange(width) + jitter[0]) / width - 0.5) * 2 * np.pi
    latitude = ((np.arange(height)[:, None] + jitter[1]) / height - 0.5) * np.pi
    level = np.cos(latitude)
    return np.stack([level * np.sin(longitude), np.sin(latitude), level * np.cos(longitude)], -1).reshape(-1, 3)


def places() -> list[np.ndarray]:
    """The matrix [4, 4] of each panorama: upright, on a rising arc in the room, turned from one to the next."""
    found = []
    for k in range(N):
        angle, turn = -1.9 + 0.22 * k, 0.3 * k
        ahead = np.array([np.cos(turn), np.sin(turn), 0.0])
        down = np.array([0.0, 0.0, -1.0])
        axes = np.stack([np.cross(down, ahead), down, ahead], axis=1)
        c2w = np.eye(4)
        c2w[:3, :3], c2w[:3, 3] = axes, [1.7 * np.cos(angle), 1.7 * np.sin(angle), 1.1 + 0.05 * k]
        found.append(c2w)
    return found


def panorama(scene, c2w: np.ndarray, width: int = WIDTH) -> np.ndarray:
    """sRGB uint8 [H, W, 3] of what is seen from a place."""
    rng, light = np.random.default_rng(0), np.zeros((width * width // 2, 3))
    for k in range(SAMPLES):
        directions = rays(width, rng) @ c2w[:3, :3].T
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(k, len(directions))
        ray = mi.RayDifferential3f(mi.Point3f(*map(float, c2w[:3, 3])), mi.Vector3f(np.float32(directions.T)))
        seen, _, _ = scene.integrator().sample(scene, sampler, ray, active=dr.full(mi.Bool, True, len(directions)))
        light += np.stack([np.array(channel) for channel in seen], axis=1)
    pixels = np.clip(linear_to_srgb(light / SAMPLES), 0, 1).reshape(width // 2, width, 3)
    return np.rint(255 * pixels).astype(np.uint8)
