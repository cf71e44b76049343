"""Charts and textures of meshes whose colours are known at every place."""

from typing import Any

import numpy as np
import pytest
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.meshing.mesh import Mesh
from mi_dogsplat.meshing.surface_colors import UNSEEN
from mi_dogsplat.meshing.texels import texels_of
from mi_dogsplat.meshing.texture import textured
from mi_dogsplat.meshing.unwrapping import unwrapped
from mi_dogsplat.scene.cameras import Camera

SIZE, FAR = 128, np.array([4e5, -2e5, 1e5])
CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 0.8]])
PYRAMID = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [1, 0, 3], [1, 3, 2]])


def colour(points: np.ndarray) -> np.ndarray:
    """[P, 3] of places, smooth."""
    return 0.5 + 0.4 * np.sin(2 * points + [0.0, 1.0, 2.0])


class Pictures(list):
    """Stands for views that were rendered."""

    near = 0.1


def pictures(places: list[tuple[float, float, float]]) -> Pictures:
    """What cameras see of the pyramid, pixel after pixel by the nearest plane that is hit."""
    views = Pictures()
    for place in places:
        camera = Camera(look_at(np.array(place), np.zeros(3), "z"), 150.0, 150.0, 48.0, 48.0, 96, 96)
        x, y = np.meshgrid(np.arange(96) + 0.5, np.arange(96) + 0.5)
        rays = np.stack([(x - 48) / 150, (y - 48) / 150, np.ones_like(x)], -1).reshape(-1, 3) @ camera.c2w[:3, :3].T
        depth = np.full(len(rays), np.inf)
        for a, b, c in CORNERS[PYRAMID]:
            solved = np.linalg.solve(
                np.stack([np.broadcast_to(b - a, rays.shape), np.broadcast_to(c - a, rays.shape), -rays], -1),
                np.broadcast_to(camera.position - a, rays.shape)[..., None],
            )[..., 0]
            hit = (solved[:, 0] >= 0) & (solved[:, 1] >= 0) & (solved[:, :2].sum(1) <= 1) & (solved[:, 2] > 0)
            depth = np.where(hit, np.minimum(depth, solved[:, 2]), depth)
        seen = np.where(np.isfinite(depth), depth, 0)
        colors = colour(camera.position + seen[:, None] * rays)
        views.append((camera, seen.reshape(96, 96), colors.reshape(96, 96, 3)))
    return views


AROUND = [(3.0, 0.4, 2.0), (-3.0, -0.4, 2.0), (0.4, 3.0, 2.0), (-0.4, -3.0, 2.0), (0.1, 0.2, -4.0)]


@pytest.mark.parametrize("unit", [2.0**-20, 2.0**20])
def test_charts_are_the_same_in_any_unit(unit):
    """A model in a small unit, as a coin in metres, had charts without an area, or at no place."""
    plain, small = (Mesh((CORNERS * k).astype(np.float32), PYRAMID) for k in (1, unit))
    (flat, expected), (scaled, uv) = unwrapped(plain, SIZE), unwrapped(small, SIZE)
    np.testing.assert_array_equal(uv, expected)
    np.testing.assert_array_equal(scaled.vertices, flat.vertices * np.float32(unit))


@pytest.mark.parametrize("away", [0 * FAR, FAR], ids=["at the origin", "far away"])
def test_charts_do_not_overlap_and_keep_every_triangle(away):
    mesh = Mesh((CORNERS + away).astype(np.float32), PYRAMID, np.ones((5, 3)))
    flat, uv = unwrapped(mesh, SIZE)
    assert flat.colors is None
    np.testing.assert_array_equal(flat.vertices[flat.faces], mesh.vertices[mesh.faces])
    assert uv.min() >= 0 and uv.max() <= 1
    texels = texels_of(flat, uv, SIZE)
    assert len(np.unique(texels.row * SIZE + texels.column)) == len(texels.row) > SIZE**2 / 4
    corners, flat_corners = flat.vertices[flat.faces].astype(float), uv[flat.faces]
    sides = [np.linalg.norm(np.diff(c, axis=1), axis=2) for c in (corners, flat_corners)]
    stretch = sides[1] / sides[0]
    assert stretch.max() < 3 * stretch.min()  # none is small in the picture that is large on the surface


def test_a_texture_has_the_colours_that_the_views_show():
    mesh, calls = Mesh(CORNERS.astype(np.float32), PYRAMID), []
    views: Any = pictures(AROUND)
    found = textured(mesh, SIZE, views, 0.05, lambda: calls.append(1))
    assert found.texture is not None and len(calls) == len(AROUND)
    texels, pixels = texels_of(found, found.texture.uv, SIZE), found.texture.pixels
    off = abs(pixels[texels.row, texels.column] - colour(texels.between(found.vertices)))
    assert off.mean() < 0.01 and off.max() < 0.1
    least, most = pixels[texels.row, texels.column].min((0,)), pixels[texels.row, texels.column].max((0,))
    assert (pixels >= least).all() and (pixels <= most).all()  # between the charts, too


def test_what_no_view_sees_lies_between_the_colours_at_its_corners():
    mesh = Mesh(CORNERS.astype(np.float32), PYRAMID)
    views: Any = pictures(AROUND[:-1])
    found = textured(mesh, SIZE, views, 0.05, lambda: None)
    assert found.texture is not None
    texels = texels_of(found, found.texture.uv, SIZE)
    below = texels.normals()[:, 2] < -0.9
    shown = found.texture.pixels[texels.row[below], texels.column[below]]
    assert below.sum() > 1000
    np.testing.assert_allclose(shown, texels.between(colour(found.vertices))[below], atol=0.1)


def test_without_any_view_of_it_a_texture_is_grey():
    views: Any = pictures([])
    found = textured(Mesh(CORNERS.astype(np.float32), PYRAMID), SIZE, views, 0.05, lambda: None)
    assert found.texture is not None and (found.texture.pixels == UNSEEN).all()


def test_no_triangles_have_no_texture():
    views: Any = pictures([])
    assert textured(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), SIZE, views, 0.05, lambda: None).texture is None
