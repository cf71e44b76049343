"""Parts of a mesh, and meshes of some of its faces."""

from dataclasses import replace

import numpy as np
from mi_dogsplat.meshing.mesh import Mesh, Texture

VERTICES = np.arange(33.0).reshape(11, 3)
FACES = np.array([[0, 1, 2], [3, 5, 4], [2, 1, 6], [7, 8, 9], [5, 3, 10], [6, 2, 0]])
MESH = Mesh(VERTICES, FACES, VERTICES / 40)


def corners(mesh: Mesh) -> list:
    return mesh.vertices[mesh.faces].tolist()


def test_parts_share_a_vertex_or_are_two():
    part = MESH.parts()
    assert len(set(part)) == 3
    assert part[0] == part[2] == part[5] and part[1] == part[4]
    assert Mesh(VERTICES, np.array([[0, 1, 2], [2, 3, 4]])).parts().tolist() == [0, 0]


def test_some_faces_keep_their_corners_and_colours():
    painted = replace(MESH, texture=Texture(VERTICES[:, :2], np.ones((4, 4, 3))))
    kept = painted.with_faces(np.array([False, True, False, True, True, False]))
    assert corners(kept) == VERTICES[FACES[[1, 3, 4]]].tolist()
    np.testing.assert_array_equal(kept.colors, kept.vertices / 40)
    assert kept.texture is not None
    np.testing.assert_array_equal(kept.texture.uv, kept.vertices[:, :2])
    assert len(kept.vertices) == 7
    assert Mesh(VERTICES, FACES).with_faces(np.ones(6, bool)).colors is None


def test_crumbs_and_all_but_the_largest_parts_leave():
    assert corners(MESH.without_crumbs(1)) == corners(MESH)
    assert corners(MESH.without_crumbs(2)) == VERTICES[FACES[[0, 1, 2, 4, 5]]].tolist()
    assert corners(MESH.without_crumbs(1, 1)) == VERTICES[FACES[[0, 2, 5]]].tolist()
    assert corners(MESH.without_crumbs(1, 9)) == corners(MESH)
    assert corners(MESH.without_crumbs(3, 2)) == VERTICES[FACES[[0, 2, 5]]].tolist()  # the second largest is a crumb
    assert not len(MESH.without_crumbs(4).faces) and not len(MESH.without_crumbs(4).vertices)
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    assert not len(empty.without_crumbs(1).faces)
