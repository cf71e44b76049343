"""Colours of points on a surface, against one point and one view after the other."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.meshing.surface_colors import surface_colors
from splat_scenes import make_camera, tilted_camera

NEAR, TOLERANCE = 0.2, 0.4
FAR = np.array([3e5, -2e5, 1e5])


class Pictures(list):
    """Stands for views that were rendered."""

    near = NEAR


@pytest.mark.parametrize("weighted", [False, True], ids=["mean", "weighted"])
@pytest.mark.parametrize("away", [0 * FAR, FAR], ids=["at the origin", "far away"])
def test_a_point_has_the_mean_colour_of_the_pixels_on_whose_surface_it_is(weighted, away):
    rng = np.random.default_rng(0)
    cameras = [tilted_camera(9, 7, f=8.0), make_camera(6, 11, f=7.0), make_camera(8, 8, f=20.0)]
    near = [camera.unproject(rng.uniform(0, 6, (40, 2)), rng.uniform(0.05, 0.5, 40)) for camera in cameras]
    points = np.concatenate([rng.uniform([-2, -2, -1], [2, 2, 4], (600, 3)), *near])
    normals = rng.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    views: Any = Pictures()
    for camera in cameras:
        depth = rng.uniform(0.1, 3, (camera.height, camera.width)) * (rng.random((camera.height, camera.width)) > 0.2)
        color = rng.random((camera.height, camera.width, 3))
        color[rng.random(depth.shape) > 0.9] = np.nan  # of photographs: what does not count
        views.append((camera, depth, color))
    expected, times, calls = np.full((len(points), 3), np.nan), np.zeros(len(points), int), []
    for i, point in enumerate(points):
        found = []
        for camera, depth, color in views:
            x, y, z = at = camera.w2c[:3, :3] @ point + camera.w2c[:3, 3]
            if z <= NEAR:
                continue
            column, row = np.floor(camera.fx * x / z + camera.cx), np.floor(camera.fy * y / z + camera.cy)
            if 0 <= column < camera.width and 0 <= row < camera.height:
                there = depth[int(row), int(column)]
                cosine = normals[i] @ (camera.position - point) / np.linalg.norm(at)
                pixel, seen = color[int(row), int(column)], there > 0 and abs(there - z) <= TOLERANCE
                if seen and (cosine > 0 or not weighted) and not np.isnan(pixel).any():
                    found.append((pixel, (cosine / z**2) ** 2 if weighted else 1))
        times[i] = len(found)
        if found:
            expected[i] = np.average([pixel for pixel, _ in found], 0, [weight for _, weight in found])
    assert {0, 1, 2} <= set(times)
    for view, (camera, *pictures) in enumerate(views):
        w2c = camera.w2c.copy()
        w2c[:3, 3] -= w2c[:3, :3] @ away
        views[view] = (replace(camera, w2c=w2c), *pictures)
    got = surface_colors(points + away, views, TOLERANCE, lambda: calls.append(1), normals if weighted else None)
    np.testing.assert_allclose(got, expected, atol=1e-4)
    assert len(calls) == len(cameras)


def test_no_points_have_no_colours():
    views: Any = Pictures([(make_camera(6, 11, f=7.0), np.ones((11, 6)), np.ones((11, 6, 3)))])
    assert surface_colors(np.zeros((0, 3)), views, TOLERANCE, lambda: None).shape == (0, 3)
