"""Views of a surface, kept or rendered again; what colours vertices have from them."""

import numpy as np
import pytest
from mi_dogsplat.meshing.surface_colors import surface_colors
from mi_dogsplat.meshing.surface_views import SurfaceViews, points_of
from mi_dogsplat.render.picture import Picture
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.srgb import linear_to_srgb
from splat_scenes import make_camera, make_splats, rounded

WIDTH, HEIGHT = 16, 12
BYTES = WIDTH * HEIGHT * (4 + 3 * 2)


def wall(opacity: float, color: float = 0.5, depth: float = 2.0) -> Splats:
    """A disc across the axis of a camera at the origin."""
    return rounded(make_splats([[0, 0, depth]], (5, 5, 1e-3), opacity, color))


def counted_views(n: int, room: int) -> tuple[SurfaceViews, list[int]]:
    """Views whose pictures hold the number of their camera, and which of them were rendered."""
    cameras = [make_camera(WIDTH, HEIGHT, 20.0 + k) for k in range(n)]
    rendered = []

    def picture(camera):
        k = int(camera.fx - 20)
        rendered.append(k)
        shape = (HEIGHT, WIDTH)
        aovs = {"median_depth.Z": np.full(shape, k + 1, np.float32)}
        return Picture(np.full((*shape, 3), k / n), np.ones(shape, np.float32), None, aovs)

    return SurfaceViews(cameras, 0.1, picture, room), rendered


@pytest.mark.parametrize("kept", [0, 2, 5])
def test_what_has_room_is_rendered_once(kept):
    views, rendered = counted_views(5, kept * BYTES + BYTES // 2)
    for _ in range(3):
        seen = list(views)
        assert [s.camera for s in seen] == views.cameras
        np.testing.assert_array_equal([s.depth[0, 0] for s in seen], [1, 2, 3, 4, 5])
        np.testing.assert_allclose([s.color[0, 0, 0] for s in seen], np.arange(5) / 5, atol=1e-3)
    again = list(range(kept, 5))
    assert rendered == [*range(5), *again, *again]


@pytest.mark.parametrize("opacity", [0.6, 0.95])
@pytest.mark.parametrize("linear", [False, True])
def test_a_colour_is_that_of_the_splats_whatever_they_let_through(opacity, linear):
    camera = make_camera(WIDTH, HEIGHT, 60.0)
    splats = brightened(wall(opacity), 3.0) if linear else wall(opacity)
    drawn = DrawnAs(linear=linear, white=3.0 if linear else 1.0)
    (seen,) = SurfaceViews.of(splats, [camera], drawn)
    assert (seen.depth > 0).all()
    np.testing.assert_allclose(seen.color, linear_to_srgb(0.5) if linear else 0.5, atol=2e-3)
    np.testing.assert_allclose(points_of(camera, seen.depth)[:, 2], 2, rtol=1e-6)


@pytest.mark.parametrize(("name", "depth"), [("median_depth", 3), ("depth", (0.4 * 2 + 0.6 * 0.5 * 3) / 0.7)])
def test_the_depth_is_that_of_what_stops_half_of_the_light_or_the_mean(name, depth):
    camera, first = make_camera(WIDTH, HEIGHT, 60.0), wall(0.4)
    both = rounded(make_splats([[0, 0, 2], [0, 0, 3]], (5, 5, 1e-3), [0.4, 0.5], 0.5))
    (seen,) = SurfaceViews.of(both, [camera], DrawnAs(), depth=name)
    np.testing.assert_allclose(seen.depth, depth, rtol=2e-3)
    (through,) = SurfaceViews.of(first, [camera], DrawnAs(), depth=name)
    assert not through.depth.any()


def test_a_vertex_has_no_colour_of_a_pixel_without_a_surface():
    """Though its distance to the camera is less than the tolerance."""
    camera = make_camera(WIDTH, HEIGHT, 60.0)
    views = SurfaceViews.of(wall(0.3), [camera], DrawnAs(near_clip=0.01))
    vertices = np.array([[0, 0, 0.05]])
    assert np.isnan(surface_colors(vertices, views, 0.2, lambda: None)).all()
    there = SurfaceViews.of(wall(0.9, 0.25, 0.1), [camera], DrawnAs(near_clip=0.01))
    np.testing.assert_allclose(surface_colors(vertices, there, 0.2, lambda: None), 0.25, atol=2e-3)
