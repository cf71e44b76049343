"""Fewer triangles: where the surface stays, what colours it has, and that it stays closed."""

from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat.meshing.mesh import Mesh
from mi_dogsplat.meshing.simplification import simplified
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]
from skimage.measure import marching_cubes

MOST = 400


def ball(centre=(0.0, 0.0, 0.0), size=24) -> Mesh:
    """Of radius 1, red above and blue below, in thousands of triangles."""
    axis = np.linspace(-1.2, 1.2, size)
    distance = np.sqrt(sum(np.square(np.meshgrid(axis, axis, axis, indexing="ij")))) - 1
    vertices, faces, _, _ = marching_cubes(distance, 0.0, spacing=(axis[1] - axis[0],) * 3)
    vertices = vertices - 1.2
    colors = np.where(vertices[:, 2:] > 0, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    return Mesh((vertices + centre).astype(np.float32), faces.astype(np.int64), colors)


def edges(mesh: Mesh) -> np.ndarray:
    """[3 F, 2] of all triangles, each with a direction."""
    return np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def test_a_ball_of_few_triangles_is_a_closed_ball_with_its_colours():
    whole, found = ball(), simplified(ball(), MOST)
    assert len(whole.faces) > 8 * MOST and 0.9 * MOST < len(found.faces) <= MOST
    assert found.vertices.dtype == np.float32 and found.colors is not None
    np.testing.assert_allclose(np.linalg.norm(found.vertices, axis=1), 1, atol=0.02)
    np.testing.assert_allclose(volume(found), volume(whole), rtol=0.02)  # as large, and the same side out
    one_way = edges(found)
    assert len(np.unique(one_way, axis=0)) == len(one_way)  # each edge once in each direction
    np.testing.assert_array_equal(np.unique(one_way, axis=0), np.unique(one_way[:, ::-1], axis=0))
    assert set(found.faces.ravel()) == set(range(len(found.vertices)))
    z = found.vertices[:, 2]
    np.testing.assert_allclose(found.colors[z > 0.25], [[1, 0, 0]] * (z > 0.25).sum(), atol=1e-6)
    np.testing.assert_allclose(found.colors[z < -0.25], [[0, 0, 1]] * (z < -0.25).sum(), atol=1e-6)


def test_far_from_the_origin_it_is_as_good():
    centre = np.array([3e3, -2e3, 1e3])
    found = simplified(ball(centre), MOST)
    assert len(found.faces) <= MOST
    np.testing.assert_allclose(np.linalg.norm(found.vertices - centre, axis=1), 1, atol=0.02)


@pytest.mark.parametrize("unit", [2.0**-20, 2.0**20])
def test_it_is_the_same_in_any_unit(unit):
    """In a small one edges collapsed in any order, and in a large one far more triangles than asked for were left."""
    whole, expected = ball(), simplified(ball(), MOST)
    found = simplified(replace(whole, vertices=whole.vertices * np.float32(unit)), MOST)
    np.testing.assert_array_equal(found.faces, expected.faces)
    np.testing.assert_array_equal(found.vertices, expected.vertices * np.float32(unit))


@pytest.mark.parametrize("most", [4000, 100_000])
def test_a_mesh_that_has_no_more_stays_as_it_is(most):
    mesh = ball(size=20)
    assert len(mesh.faces) < 4000
    assert simplified(mesh, most) is mesh


def test_without_colours_there_are_none():
    mesh = ball()
    assert simplified(Mesh(mesh.vertices, mesh.faces), MOST).colors is None


def test_the_same_mesh_gives_the_same_bits():
    first, second = simplified(ball(), MOST), simplified(ball(), MOST)
    for name in ("vertices", "faces", "colors"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_flat_parts_are_few_triangles_and_keep_their_edge():
    """A square of 800 triangles, which four tell."""
    axis = np.arange(21) / 20
    vertices = np.stack([*np.meshgrid(axis, axis), np.zeros((21, 21))], axis=-1).reshape(-1, 3).astype(np.float32)
    first = (np.arange(20)[:, None] * 21 + np.arange(20)).ravel()
    faces = np.concatenate([first[:, None] + (0, 1, 21), first[:, None] + (1, 22, 21)])
    found = simplified(Mesh(vertices, faces), 16)
    a, b, c = (found.vertices[found.faces[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)[:, 2] / 2
    assert len(found.faces) <= 16 and areas.min() > 0 and areas.sum() == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_flat_walls_have_no_corners_far_away(seed):
    """Along a wall nothing says where a corner should be, and along an edge between two only where on a line."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    places = np.stack(np.meshgrid(*[np.arange(24.0) - 11.5] * 3, indexing="ij"), axis=-1)
    x, _, z = np.moveaxis(places @ turn.T, -1, 0)
    for distance in (z, np.abs(z) - 1.5, np.maximum(z, x)):
        vertices, faces, _, _ = marching_cubes(np.clip(distance, -4, 4).astype(np.float32), 0.0)
        whole = Mesh(vertices.astype(np.float32), faces.astype(np.int64))
        found = simplified(whole, len(faces) // 10)
        assert len(found.faces) <= len(faces) // 10
        away = cKDTree(whole.vertices).query(found.vertices)[0]
        assert away.max() < 2.5  # voxels


def test_a_vertex_that_is_in_no_triangle_takes_part_in_nothing():
    whole, expected = ball(), simplified(ball(), MOST)
    assert whole.colors is not None
    alone = Mesh(
        np.concatenate([whole.vertices, [[0.9, 0, 0]]]).astype(np.float32),
        whole.faces,
        np.concatenate([whole.colors, [[0, 1, 0]]]),
    )
    found = simplified(alone, MOST)
    assert found.colors is not None and expected.colors is not None and len(found.faces) == len(expected.faces)
    assert np.isfinite(found.vertices).all() and found.colors[:, 1].max() == 0
