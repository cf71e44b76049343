"""The region of a viewport that our engine draws: its view as a camera, and the part of it that is rendered."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from live_views import PERSPECTIVE, SIZE
from mathutils import Matrix, Vector

from blender_addon.viewport.region import rendered_part, seen_by
from blender_addon.viewport.rendered import border_of

VIEWS = {  # window matrices: as a person looks, through a camera that is zoomed and shifted, and along parallel rays
    "perspective": PERSPECTIVE,
    "camera": ((3.1, 0, 0.4, 0), (0, 4.4, -0.7, 0), (0, 0, -1.002, -0.2002), (0, 0, -1, 0)),
    "orthographic": ((0.4, 0, 0, 0.1), (0, 0.6, 0, -0.2), (0, 0, -0.01, 0), (0, 0, 0, 1)),
    "orthographic camera": ((0.4, 0, 0, 0.1), (0, 0.6, 0, -0.2), (0, 0, -0.02, -1.02), (0, 0, 0, 1)),
}


@pytest.fixture(params=VIEWS)
def space(request):
    """A ``RegionView3D`` that has a pose."""
    pose = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.7, 4, (1, 2, 3))
    return SimpleNamespace(
        view_matrix=pose.inverted(),
        window_matrix=Matrix(VIEWS[request.param]),
        is_perspective=request.param in ("perspective", "camera"),
    )


def test_points_are_where_blender_draws_them(space):
    """To a hundredth of a pixel, whatever the resolution and the part of the region."""
    width, height = 300, 200
    seen = seen_by(space, width, height)
    assert seen.camera.w2c.shape == (4, 4) and seen.camera.orthographic is not space.is_perspective
    for local in ((0.3, -0.2, -5.0), (-0.5, 0.8, -20.0), (0.1, 0.1, -90.0)):
        point = space.view_matrix.inverted() @ Vector(local)
        x, y, z, w = space.window_matrix @ Vector((*local, 1.0))
        expected = width / 2 * (1 + x / w), height / 2 * (1 - y / w)
        assert np.allclose(seen.pixels(np.array([point])), expected, atol=1e-2)
        small = seen.scaled(0.5)
        assert (small.camera.width, small.camera.height) == (150, 100)
        assert np.allclose(small.pixels(np.array([point])), np.divide(expected, 2), atol=1e-2)
        part = seen.window(40, 30, 100, 90)
        assert np.allclose(part.pixels(np.array([point])), np.subtract(expected, (40, 30)), atol=1e-2)
        assert small.camera.film is None and part.scaled(0.5).camera.film == (-20, -15, 130, 85)
        depth = (seen.camera.w2c @ (*point, 1.0))[2]
        near, far = seen.clip
        if space.is_perspective:
            share = far / (far - near) * (1 - near / depth)  # as OpenGL has it, from 0 to 1
        else:
            share = (depth - near) / (far - near)
        assert near >= 0 and share == pytest.approx((z / w + 1) / 2, abs=1e-3)


def test_the_same_view_is_told_from_another(space):
    seen = seen_by(space, *SIZE)
    assert seen.same(seen_by(space, *SIZE)) and not seen.same(None) and not seen.same(seen_by(space, 96, 65))
    space.view_matrix = space.view_matrix @ Matrix.Translation((0, 0, 1e-3))
    assert not seen.same(seen_by(space, *SIZE))


def test_a_border_is_a_part_of_the_region_or_of_the_picture_of_the_camera(scene, space):
    seen = seen_by(space, 300, 200)
    assert rendered_part(seen, None, None) == (0, 0, 300, 200)
    assert rendered_part(seen, None, (0.1, 0.5, 0.25, 0.75)) == (30, 50, 150, 150)
    local = [(x, y, -10.0) for x in (-0.5, 0.5) for y in (-0.25, 0.25)]
    corners = np.array([space.view_matrix.inverted() @ Vector(corner) for corner in local])
    pixels = seen.pixels(corners)
    left, top, right, bottom = rendered_part(seen, corners, (0.0, 1.0, 0.0, 1.0))
    assert np.allclose((left, top), pixels.min(0), atol=0.5) and np.allclose((right, bottom), pixels.max(0), atol=0.5)
    half = rendered_part(seen, corners, (0.0, 0.5, 0.5, 1.0))  # its upper left quarter
    assert half[:2] == (left, top) and half[2] <= (left + right) / 2 + 1 and half[3] <= (top + bottom) / 2 + 1
    assert rendered_part(seen, corners + 1e3, (0.0, 1.0, 0.0, 1.0))[2] > 0  # outside: still a pixel


def test_a_view_through_what_is_no_camera_is_drawn_as_a_whole(scene):
    """Blender looks through any object; a border of the render is that of a camera's picture."""
    scene.render.use_border, scene.render.border_max_x = True, 0.5
    graph = bpy.context.evaluated_depsgraph_get()
    for data, kind in ((bpy.data.lights.new("Lamp", "SPOT"), None), (None, None), (bpy.data.cameras.new("C"), 0.5)):
        obj = bpy.data.objects.new("Eye", data)
        scene.collection.objects.link(obj)
        graph.update()
        space = SimpleNamespace(camera=obj, use_render_border=False)
        context = SimpleNamespace(space_data=space, region_data=SimpleNamespace(view_perspective="CAMERA"))
        corners, border = border_of(context, graph)
        assert (corners is None) == (kind is None) and (border and border[1]) == kind
