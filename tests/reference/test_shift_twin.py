"""Places that depend on the view, in the float64 twin: pictures and gradients against differences."""

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.reference.gradients import gradients_tiled
from splat_scenes import differences, make_splats, random_splats, tilted_camera
from tiled_twin import BACKGROUND, SMALL, SMOOTH, adjoint_of, assert_gradients_near, assert_images_equal


@pytest.mark.parametrize("smooth", [False, True])
def test_the_tiled_image_is_that_of_the_plain_twin(smooth):
    assert_images_equal(random_splats(40, seed=1, shift_share=0.6), tilted_camera(53, 37), smooth)


@pytest.mark.parametrize("others", [{}, {"slope_share": 0.5, "cut_share": 0.5, "curvature_share": 0.5}],
                         ids=["alone", "with all else"])  # fmt: skip
def test_gradients_equal_differences(others):
    splats, adjoint = random_splats(6, seed=3, degree=2, shift_share=0.7, **others), adjoint_of(SMALL)

    def loss(moved) -> float:
        return float((adjoint * reference.render(moved, SMALL, BACKGROUND, smooth=True)[0]).sum())

    found = gradients_tiled(splats, SMALL, adjoint, BACKGROUND, **SMOOTH)
    expected = differences(splats, loss, eps=1e-6)
    assert {"view_shifts", "mean_views"} <= set(found)
    assert_gradients_near(found, expected, rtol=1e-6)


def test_one_that_is_not_finite_is_not_drawn():
    splats = random_splats(6, seed=3, degree=0, shift_share=1.0)
    splats.view_shifts[1, 0, 2], splats.mean_views[4, 1] = np.nan, np.inf
    visible = reference.project(splats, tilted_camera()).visible
    np.testing.assert_array_equal(visible, [True, False, True, True, False, True])


def test_one_that_is_moved_behind_the_camera_is_not_drawn():
    splats = make_splats([[0, 0, 2], [0, 0, 2]], 0.5)
    splats.shift_index, splats.mean_views = np.array([1]), np.zeros((1, 3))
    splats.view_shifts = np.diag([0, 0, -4.5])[None]
    camera = tilted_camera()
    np.testing.assert_array_equal(reference.project(splats, camera).visible, [True, False])
    splats.view_shifts = np.diag([0, 0, -2.0])[None]
    depths = reference.project(splats, camera).depths
    assert depths[1] < depths[0] - 0.5
