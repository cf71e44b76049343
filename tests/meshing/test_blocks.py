"""Blocks of voxels: that none is missing where a surface or a camera is near, and what finds them again."""

import numpy as np
import pytest
from mi_dogsplat.meshing.blocks import HALF, SIDE, BlockFinder, Blocks, keys_of, places_of
from splat_scenes import tilted_camera

CENTRE = np.array([0.3, -0.2, 4.0])


def voxels(blocks: Blocks) -> np.ndarray:
    """[B, SIDE³, 3] world positions."""
    steps = np.array(list(np.ndindex(SIDE, SIDE, SIDE)))
    return blocks.corners[:, None] + blocks.voxel * steps


def test_a_place_has_a_key_of_its_own_and_comes_back():
    rng = np.random.default_rng(0)
    edges = np.array([[-HALF] * 3, [HALF - 1] * 3, [0, 0, 0], [-1, 0, 1]])
    places = np.concatenate([edges, rng.integers(-HALF, HALF, (500, 3))])
    keys = keys_of(places)
    np.testing.assert_array_equal(places_of(keys), places)
    assert len(np.unique(keys)) == len(np.unique(places, axis=0))
    order = np.lexsort(places.T[::-1])
    np.testing.assert_array_equal(np.argsort(keys, kind="stable"), order)


@pytest.mark.parametrize("reach_in_voxels", [1.0, 4.0, 11.0])
def test_every_voxel_within_reach_of_a_point_is_in_a_block(reach_in_voxels):
    rng = np.random.default_rng(1)
    voxel, reach = 0.05, 0.05 * reach_in_voxels
    points = CENTRE + rng.uniform(-1, 1, (40, 3))
    finder = BlockFinder(CENTRE, voxel, reach)
    for part in np.array_split(points, 3):
        finder.add(part)
    blocks = finder.blocks()
    grid = np.array(list(np.ndindex(61, 61, 61))) - 30
    world = CENTRE + voxel * grid
    near = np.zeros(len(grid), bool)
    for point in points:
        near |= np.abs(world - point).max(axis=1) <= reach
    assert (blocks.rows(grid[near] // SIDE) >= 0).all()
    far = np.abs(blocks.corners[:, None] + voxel * (SIDE - 1) / 2 - points).max(axis=2).min(axis=1)
    assert far.max() <= 2 * reach + voxel * SIDE  # and no block is far from all


@pytest.mark.parametrize("factor", [1, 2, 3, 7])
def test_coarser_blocks_are_those_of_the_same_points(factor):
    points = CENTRE + np.random.default_rng(4).uniform(-2, 2, (60, 3))
    fine, coarse = BlockFinder(CENTRE, 0.03, 0.12), BlockFinder(CENTRE, factor * 0.03, factor * 0.12)
    fine.add(points)
    coarse.add(points)
    blocks = fine.coarser(factor).blocks()
    assert blocks.voxel == factor * 0.03
    np.testing.assert_array_equal(blocks.keys, coarse.blocks().keys)


def test_rows_are_those_of_the_blocks_or_none():
    blocks = Blocks(CENTRE, 0.1, np.unique(keys_of(np.array([[0, 0, 0], [1, -2, 3], [-5, 4, 0]]))))
    np.testing.assert_array_equal(blocks.rows(blocks.places), [0, 1, 2])
    np.testing.assert_array_equal(blocks.rows(np.array([[0, 0, 1], [9, 9, 9], [-9, 0, 0]])), [-1, -1, -1])


def test_no_block_is_left_out_that_a_camera_sees():
    camera, near = tilted_camera(), 0.5
    places = np.array(list(np.ndindex(9, 9, 9))) - 4
    blocks = Blocks(CENTRE, 0.15, np.unique(keys_of(places)))
    pixels, z = camera.project(voxels(blocks).reshape(-1, 3))
    inside = (z > near) & (pixels >= 0).all(axis=1) & (pixels < (camera.width, camera.height)).all(axis=1)
    seen = np.flatnonzero(inside.reshape(len(places), -1).any(axis=1))
    found = blocks.seen_by(camera, near)
    assert set(seen) <= set(found)
    assert len(seen) < len(found) < 1.8 * len(seen) < len(places)


def test_at_least_is_the_number_of_blocks_where_cells_fill_them():
    blocks = np.array([[0, 0, 0], [0, 0, 1], [-2, 1, 0]])
    for cells_of_block in (1, 2):  # along an edge
        cells = np.array(list(np.ndindex((cells_of_block,) * 3))) + 0.5  # their middles
        finder = BlockFinder(CENTRE, 0.05, 0.05 * SIDE / cells_of_block)
        finder.add(CENTRE + finder.reach * (blocks[:, None] * cells_of_block + cells).reshape(-1, 3))
        assert finder.coarser(1).at_least == len(blocks)
