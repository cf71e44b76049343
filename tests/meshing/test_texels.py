"""Which pixels of a texture lie in which triangle, against one pixel and one triangle after the other."""

import numpy as np
from mi_dogsplat.meshing import texels
from mi_dogsplat.meshing.mesh import Mesh
from mi_dogsplat.meshing.texels import texels_of

SIZE = 23


def strewn(n: int) -> tuple[Mesh, np.ndarray]:
    """Triangles anywhere in space and in the picture, some beyond its border; one of them has no area there."""
    rng = np.random.default_rng(1)
    vertices, uv = rng.normal(size=(3 * n, 3)), rng.uniform(-0.1, 1.1, (3 * n, 2))
    uv[2] = uv[0]
    return Mesh(vertices, np.arange(3 * n).reshape(n, 3)), uv


def expected_of(mesh: Mesh, uv: np.ndarray) -> dict[tuple[int, int, int], np.ndarray]:
    """(row, column, face) to the point there: the weights solve linear equations."""
    found = {}
    for face, corners in enumerate(mesh.faces):
        system = np.vstack([uv[corners].T * SIZE, np.ones(3)])
        if abs(np.linalg.det(system)) < 1e-9:
            continue
        for row in range(SIZE):
            for column in range(SIZE):
                weights = np.linalg.solve(system, [column + 0.5, row + 0.5, 1])
                if (weights >= 0).all():
                    found[row, column, face] = weights @ mesh.vertices[corners]
    return found


def test_pixels_have_the_points_and_normals_of_the_triangles_that_they_lie_in(monkeypatch):
    mesh, uv = strewn(12)
    expected = expected_of(mesh, uv)
    for at_once in (texels.AT_ONCE, 100):  # in several pieces, too
        monkeypatch.setattr(texels, "AT_ONCE", at_once)
        got = texels_of(mesh, uv, SIZE)
        faces = sorted(expected, key=lambda key: key[2])
        assert [(row, column) for row, column, _ in faces] == list(zip(got.row, got.column, strict=True))
        np.testing.assert_allclose(got.between(mesh.vertices), [expected[key] for key in faces], atol=1e-12)
        for (_, _, face), normal in zip(faces, got.normals(), strict=True):
            a, b, c = mesh.vertices[mesh.faces[face]]
            np.testing.assert_allclose(normal, np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a)))
