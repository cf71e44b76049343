"""Colours of vertices, against one vertex and one view after the other."""

from typing import Any

import numpy as np
from mi_dogsplat.meshing.vertex_colors import UNSEEN, vertex_colors
from splat_scenes import make_camera, tilted_camera

NEAR, TOLERANCE = 1.0, 0.4


class Pictures(list):
    """Stands for views that were rendered."""

    near = NEAR


def test_a_vertex_has_the_mean_colour_of_the_pixels_on_whose_surface_it_is():
    rng = np.random.default_rng(0)
    cameras = [tilted_camera(9, 7, f=8.0), make_camera(6, 11, f=7.0), make_camera(8, 8, f=20.0)]
    vertices = rng.uniform([-2, -2, -1], [2, 2, 4], (600, 3))
    views: Any = Pictures()
    for camera in cameras:
        depth = rng.uniform(0.5, 4, (camera.height, camera.width)) * (rng.random((camera.height, camera.width)) > 0.2)
        views.append((camera, depth, rng.random((camera.height, camera.width, 3))))
    expected, times, calls = np.full((len(vertices), 3), UNSEEN), np.zeros(len(vertices), int), []
    for i, vertex in enumerate(vertices):
        found = []
        for camera, depth, color in views:
            x, y, z = camera.w2c[:3, :3] @ vertex + camera.w2c[:3, 3]
            if z <= NEAR:
                continue
            column, row = np.floor(camera.fx * x / z + camera.cx), np.floor(camera.fy * y / z + camera.cy)
            if 0 <= column < camera.width and 0 <= row < camera.height:
                there = depth[int(row), int(column)]
                if there > 0 and abs(there - z) <= TOLERANCE:
                    found.append(color[int(row), int(column)])
        times[i] = len(found)
        if found:
            expected[i] = np.mean(found, axis=0)
    assert {0, 1, 2} <= set(times)
    got = vertex_colors(vertices, views, TOLERANCE, lambda: calls.append(1))
    np.testing.assert_allclose(got, expected, rtol=1e-12)
    assert len(calls) == len(cameras)
