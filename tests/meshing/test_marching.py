"""Triangles of distances: closed, outside outwards, the same across chunks, and none where nothing is known."""

import numpy as np
import pytest
from mi_dogsplat.meshing.blocks import SIDE, BlockFinder, Blocks
from mi_dogsplat.meshing.marching import EDGE, zero_surface
from mi_dogsplat.meshing.mesh import Mesh
from scipy.ndimage import gaussian_filter

VOXEL, CENTRE = 0.01, np.array([5.0, 0.0, -2.0])


def field(function, extent: int) -> tuple[Blocks, np.ndarray]:
    """Blocks near the zeros of a function of voxel coordinates within ``extent``, and its values there."""
    grid = np.stack(np.meshgrid(*[np.arange(-extent, extent)] * 3, indexing="ij"), -1).reshape(-1, 3)
    finder = BlockFinder(CENTRE, VOXEL, 2 * VOXEL)
    finder.add(CENTRE + VOXEL * grid[abs(function(grid)) < 1])
    blocks = finder.blocks()
    steps = np.array(list(np.ndindex(SIDE, SIDE, SIDE)))
    places = (SIDE * blocks.places[:, None] + steps).reshape(-1, 3)
    return blocks, function(places).reshape(-1, SIDE, SIDE, SIDE)


def open_edges(mesh: Mesh) -> int:
    """Edges of a triangle that no other one has the other way round."""
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    n = len(mesh.vertices)
    there, back = edges[:, 0] * n + edges[:, 1], edges[:, 1] * n + edges[:, 0]
    assert len(np.unique(there)) == len(there)
    return int((~np.isin(back, there)).sum())


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - CENTRE for k in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


def test_a_ball_across_chunks_is_closed_and_has_its_volume_outwards():
    middle, radius = np.array([0.3, -0.2, 0.4]), 25.2  # in eight chunks, which meet at 0
    mesh = zero_surface(*field(lambda p: np.linalg.norm(p - middle, axis=-1) - radius, 32))
    assert open_edges(mesh) == 0
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi * (VOXEL * radius) ** 3, rel=2e-3)
    distances = np.linalg.norm((mesh.vertices - CENTRE) / VOXEL - middle, axis=1)
    np.testing.assert_allclose(distances, radius, atol=0.01)
    assert (mesh.vertices - CENTRE).min() < 0 < (mesh.vertices - CENTRE).max()
    assert mesh.parts().max() == 0


def test_any_smooth_field_gives_closed_surfaces():
    rng, n = np.random.default_rng(0), 2 * 40
    noise = gaussian_filter(rng.normal(size=(n, n, n)), 2.0)
    noise /= noise.std()

    def function(p):
        x, y, z = np.clip(p + n // 2, 0, n - 1).T
        return noise.T[z, y, x].reshape(p.shape[:-1]) + 5 * np.maximum(0, abs(p).max(axis=-1) - 34)

    mesh = zero_surface(*field(function, 40))
    assert len(mesh.faces) > 20_000 and mesh.parts().max() > 3
    assert open_edges(mesh) == 0


def test_a_distance_of_exactly_0_makes_no_triangle_without_area_and_no_hole():
    mesh = zero_surface(*field(lambda p: abs(p).max(axis=-1) - 9.0, 16))
    assert open_edges(mesh) == 0
    assert volume(mesh) == pytest.approx((18 * VOXEL) ** 3, rel=0.02)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_where_nothing_is_known_there_are_no_triangles(axis):
    """A plane of which one half is told: it ends with the last voxel that is."""
    blocks, distances = field(lambda p: p[..., (axis + 1) % 3] - 0.25, 12)
    steps = np.array(list(np.ndindex(SIDE, SIDE, SIDE)))
    coordinate = (SIDE * blocks.places[:, None] + steps)[..., axis].reshape(distances.shape)
    mesh = zero_surface(blocks, np.where(coordinate <= 5, distances, np.nan))
    assert mesh.vertices[:, axis].max() == pytest.approx(CENTRE[axis] + 5 * VOXEL)
    np.testing.assert_allclose(mesh.vertices[:, (axis + 1) % 3], CENTRE[(axis + 1) % 3] + 0.25 * VOXEL, atol=1e-6)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    sides = np.delete(high - low, (axis + 1) % 3)
    assert area == pytest.approx(sides.prod(), rel=1e-6)  # without a hole, and no triangle twice


def test_of_no_surface_there_is_no_mesh():
    blocks, distances = field(lambda p: np.linalg.norm(p, axis=-1) - 5, 8)
    for values in (distances + 99, np.full_like(distances, np.nan)):
        mesh = zero_surface(blocks, values)
        assert mesh.vertices.shape == mesh.faces.shape == (0, 3)
    assert EDGE == 64
