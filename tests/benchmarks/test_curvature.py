"""Products with the Jacobian and what is made of them, against matrices that are written out."""

import numpy as np
import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import RAW, RAW_DOG
from mi_dogsplat.reference.gradients import gradients_tiled
from splat_scenes import SMOOTH_OPTIONS, random_splats, rounded, tilted_camera
from tiny_data import truth, write_tiny_data

from benchmarks.numerics import curvature

OPTIONS = RasterOptions(sh_degree=1, **SMOOTH_OPTIONS)
BACKGROUND = 0.3


@pytest.fixture(scope="module")
def small():
    """Jacobian of six primitives in two views; the same in float64, [3 pixels of all views, parameters]."""
    splats = rounded(random_splats(6, seed=3, degree=1, dog_share=0.5))
    cameras = [tilted_camera(6, 5, f=6.0, cx=3.0, cy=2.5), tilted_camera(5, 4, f=7.0, cx=2.0, cy=2.5)]
    rows = []
    for camera in cameras:
        for channel in range(3):
            for y in range(camera.height):
                for x in range(camera.width):
                    one = np.zeros((camera.height, camera.width, 3))
                    one[y, x, channel] = 1
                    found = gradients_tiled(splats, camera, one, [BACKGROUND] * 3, min_alpha=0, min_transmittance=0)
                    rows.append(np.concatenate([found[name].ravel() for name in RAW + RAW_DOG]))
    return curvature.Jacobian(splats, cameras, OPTIONS, BACKGROUND), np.array(rows)


def test_products_with_the_gauss_newton_matrix_are_those_of_the_matrix(small):
    jacobian, dense = small
    matrix = 2 / len(dense) * dense.T @ dense
    for seed in range(3):
        vector = np.random.default_rng(seed).normal(size=len(matrix))
        expected = matrix @ vector
        found = jacobian.gauss_newton(vector)
        assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()


def test_every_parameter_is_of_one_kind(small):
    jacobian, dense = small
    every = np.concatenate(list(jacobian.kinds.values()))
    assert sorted(every) == list(range(dense.shape[1]))
    assert [len(jacobian.kinds[name]) for name in ("means", "sh_dc", "sh_rest", "dog_log_scales")] == [18, 18, 54, 9]


def test_the_diagonal_is_that_of_the_matrix(small):
    jacobian, dense = small
    expected = 2 / len(dense) * np.square(dense).sum(0)
    found = jacobian.diagonal(200, np.random.default_rng(1))
    large = expected > 1e-6 * expected.max()
    np.testing.assert_allclose(found[large], expected[large], rtol=0.5)  # √(2/200) is the scatter of one
    assert np.mean(found[large] / expected[large]) == pytest.approx(1, abs=0.03)


def test_lanczos_finds_the_ends_of_a_spectrum_and_how_many_there_are_of_each_size():
    rng = np.random.default_rng(0)
    values = np.concatenate([np.full(100, 0.02), np.full(60, 0.5), np.linspace(3, 5, 40)])
    turn = np.linalg.qr(rng.normal(size=(200, 200)))[0]
    matrix = (turn * values) @ turn.T
    ritz = curvature.lanczos(lambda v: matrix @ v, rng.choice([-1.0, 1.0], 200), 40)
    assert ritz.values[[0, -1]] == pytest.approx([0.02, 5], rel=1e-3)
    assert [ritz.share_above(v) for v in (0.01, 0.1, 1, 10)] == pytest.approx([1, 0.5, 0.2, 0], abs=0.12)
    assert abs(ritz.top @ turn[:, -1]) == pytest.approx(1, abs=1e-2)
    assert ritz.weights.sum() == pytest.approx(1)


def test_what_does_the_same_couples_as_often_as_it_is_there():
    """Four parameters of one effect, and two that stand alone, in units of very different size."""
    columns = np.eye(3)[:, [0, 0, 0, 0, 1, 2]] * [1, 10, 100, 1000, 1e-3, 7]
    matrix, active = columns.T @ columns, np.array([0, 1, 2, 3, 4, 5])
    apply = curvature.scaled(lambda v: matrix @ v, np.diag(matrix).copy(), active)
    ritz = curvature.lanczos(apply, np.array([1.0, 1, -1, 1, 1, -1]), 6)
    assert ritz.values[-1] == pytest.approx(4) and ritz.participants == pytest.approx(4)
    without = curvature.scaled(lambda v: matrix @ v, np.diag(matrix).copy(), active[3:])
    assert curvature.lanczos(without, np.array([1.0, 1, 1]), 3).values[-1] == pytest.approx(1)


def test_the_noise_of_views_that_scatter_about_a_gradient_is_their_variance_over_its_square():
    rng = np.random.default_rng(2)
    gradients = 0.5 + 2.0 * rng.normal(size=(4000, 50))
    assert curvature.noise(gradients) == pytest.approx((16, 16), rel=0.1)
    units = np.logspace(-6, 6, 50)
    assert curvature.noise(gradients * units)[1] == pytest.approx(curvature.noise(gradients)[1])
    assert curvature.noise(np.ones((5, 3))) == (0, 0)


def test_gradients_of_views_are_those_that_training_has(tmp_path):
    dataset = load_dataset(write_tiny_data(tmp_path))
    gradients, kinds = curvature.view_gradients(truth(), dataset, 0.0)
    moved = truth()
    moved.sh_coeffs[:, 0] += 0.5
    worse, _ = curvature.view_gradients(moved, dataset, 0.0)
    assert len(gradients) == len(dataset.train)
    color = kinds["sh_dc"]
    assert (worse[:, color].sum(1) > 5 * np.abs(gradients[:, color].sum(1))).all()  # all of it asks for less colour
