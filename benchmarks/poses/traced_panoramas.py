"""Panoramas of all directions whose exact places are known: a Mitsuba scene traced by rays from each place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.poses.panoramas import SIDES, side_rotation, side_size
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.srgb import linear_to_srgb


def places(n: int, between: int = 1) -> list[np.ndarray]:
    """The matrices [4, 4] of panoramas: upright, on a rising arc in a room, each one turned further; ``n``
    steps along it, each made in so many."""
    found = []
    for k in np.arange(n * between) / between:
        angle, turn = -1.9 + 0.22 * k, 0.3 * k
        ahead = np.array([np.cos(turn), np.sin(turn), 0.0])
        down = np.array([0.0, 0.0, -1.0])
        c2w = np.eye(4)
        c2w[:3, :3] = np.stack([np.cross(down, ahead), down, ahead], axis=1)
        c2w[:3, 3] = 1.7 * np.cos(angle), 1.7 * np.sin(angle), 1.1 + 0.05 * k
        found.append(c2w)
    return found


def exact_cameras(c2ws: Sequence[np.ndarray], width: int) -> dict[str, Camera]:
    """Of the views of panoramas ``IMG <k>`` of this width, by the names that they get."""
    size, found = side_size(width), {}
    for k, c2w in enumerate(c2ws):
        for side in SIDES:
            turned = c2w.copy()
            turned[:3, :3] = c2w[:3, :3] @ side_rotation(side).T
            found[f"{side}_IMG_{k}"] = Camera(np.linalg.inv(turned), *(size / 2,) * 4, width=size, height=size)
    return found


def panorama(scene: Any, c2w: np.ndarray, width: int, spp: int) -> np.ndarray:
    """sRGB uint8 [H, W, 3] of what is seen from a place, with ``spp`` jittered rays a pixel."""
    rng, light = np.random.default_rng(0), np.zeros((width * width // 2, 3))
    origin = mi.Point3f(*map(float, c2w[:3, 3]))
    for k in range(spp):
        rays = (_rays(width, rng) @ c2w[:3, :3].T).astype(np.float32)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(k, len(rays))
        ray, active = mi.RayDifferential3f(origin, mi.Vector3f(rays.T)), dr.full(mi.Bool, True, len(rays))
        seen, _, _ = scene.integrator().sample(scene, sampler, ray, active=active)
        light += np.stack([np.array(channel) for channel in seen], axis=1)
    pixels = np.clip(linear_to_srgb(light / spp), 0, 1).reshape(width // 2, width, 3)
    return np.rint(255 * pixels).astype(np.uint8)


def _rays(width: int, rng: np.random.Generator) -> np.ndarray:
    """Directions [H * W, 3], one somewhere in each pixel: x right, y down, z ahead."""
    height = width // 2
    jitter = rng.random((2, height, width))
    longitude = ((np.arange(width) + jitter[0]) / width - 0.5) * 2 * np.pi
    latitude = ((np.arange(height)[:, None] + jitter[1]) / height - 0.5) * np.pi
    level = np.cos(latitude)
    return np.stack([level * np.sin(longitude), np.sin(latitude), level * np.cos(longitude)], -1).reshape(-1, 3)
