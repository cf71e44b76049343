"""The tree over the primitives: who its leaves are, and what its boxes hold."""

import drjit as dr
import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.geometry import Cutoffs
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.reference.quaternions import rotations
from mi_dogsplat.tracing.bounds import bounds_of
from mi_dogsplat.tracing.primitives import primitives_of
from mi_dogsplat.tracing.tree import NONE, ROW, build, leaf_order
from splat_scenes import random_splats, rounded


@pytest.mark.parametrize("offset", [(0, 0, 0), (-40, 0, 30)])  # the empty are nowhere: neither at the origin
@pytest.mark.parametrize("n", [1, 2, 37, 64, 100])
def test_nodes_are_cut_across_their_longest_axis(n, offset):
    points = np.random.default_rng(n).normal(size=(n, 3)) * [1, 3, 0.5] + offset
    order = leaf_order([array_types().Float(column.astype(np.float32)) for column in points.T], n).numpy()
    assert len(order) == max(2, 2 ** int(np.ceil(np.log2(n)))) and sorted(order[order != NONE]) == list(range(n))
    block = len(order)
    while block > 1:
        for first in range(0, len(order), block):
            left, right = (half[half != NONE] for half in np.split(order[first : first + block], 2))
            assert len(left) == min(block // 2, len(left) + len(right)), "what is empty comes last"
            if len(right):
                both = points[np.concatenate([left, right])]
                size = np.ptp(both, axis=0)
                along = points[:, np.argmax(size)]
                assert along[left].max() <= along[right].min() + 1e-6 * size.max()
        block //= 2


def test_a_box_holds_the_boxes_of_all_leaves_below():
    splats = rounded(random_splats(45, seed=31))
    splats.logit_opacities[:5] = -7  # not drawn
    primitives = primitives_of(upload(splats), splats.sh_degree)
    reach = Cutoffs().log2_range
    bounds, tree = bounds_of(primitives, reach), build(primitives, reach)
    assert tree is not None and tree.n_leaves == 64
    leaves = tree.splat_from_leaf.numpy()
    assert sorted(leaves[leaves != NONE]) == list(range(5, 45))
    low, high = (np.stack([column.numpy() for column in side], 1) for side in (bounds.low, bounds.high))
    table = tree.nodes.numpy().reshape(-1, ROW)
    for node in range(2, 2 * tree.n_leaves):
        box = table[node // 2, 6 * (node % 2) : 6 * (node % 2) + 6]
        first, last = node, node
        while first < tree.n_leaves:
            first, last = 2 * first, 2 * last + 1
        below = leaves[first - tree.n_leaves : last + 1 - tree.n_leaves]
        below = below[below != NONE]
        if len(below):
            np.testing.assert_array_equal(box, [*low[below].min(0), *high[below].max(0)])
        else:
            assert (box > 1e29).all(), "no ray passes there"


def test_the_box_of_a_primitive_is_that_of_its_cutoff_ellipsoid():
    """Points on the surface of both kernels' ellipsoids are within it, and reach all of its sides of a Gaussian."""
    splats = rounded(random_splats(30, seed=32))
    bounds = bounds_of(primitives_of(upload(splats), splats.sh_degree), Cutoffs().log2_range)
    low, high = (np.stack([column.numpy() for column in side], 1) for side in (bounds.low, bounds.high))
    directions = np.random.default_rng(33).normal(size=(20_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    R, drawn = rotations(splats.quats.astype(float)), bounds.drawn.numpy()
    opacities, dog = splats.opacities.astype(float), dict(zip(splats.dog_index, range(splats.n_dog), strict=True))
    np.testing.assert_array_equal(drawn, opacities > 1 / 255)
    for i in np.flatnonzero(drawn):
        axes = np.sqrt(2 * np.log(255 * opacities[i])) * splats.scales[i]
        reached = splats.means[i] + (directions * axes) @ R[i].T
        inside = [reached]
        if i in dog:
            f_a = 1 / (1 + np.exp(-splats.dog_logit_opacities[dog[i]]))
            radius = np.sqrt(2 * np.log(max(255 * f_a * opacities[i], 1)))
            pseudo_axes = radius * splats.scales[i] * np.exp(splats.dog_log_scales[dog[i]])
            inside.append(splats.means[i] + (directions * pseudo_axes) @ R[i].T)
        else:
            np.testing.assert_allclose([low[i], high[i]], [reached.min(0), reached.max(0)], atol=0.02 * axes.max())
        assert all((low[i] <= points.min(0)).all() and (points.max(0) <= high[i]).all() for points in inside)


def test_nothing_drawn_is_no_tree():
    splats = rounded(random_splats(4, seed=34))
    splats.logit_opacities[:] = -9
    assert build(primitives_of(upload(splats), splats.sh_degree), Cutoffs().log2_range) is None
    assert dr.width(bounds_of(primitives_of(upload(splats), 3), 8.0).drawn) == 4
