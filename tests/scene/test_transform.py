"""Similarity transforms: a moved model seen by a moved camera is the same picture."""

import re
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from mi_dogsplat import Model, reference
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.quaternions import (
    quaternion_from_rotation,
    quaternion_product,
    rotated,
    rotation_from_quaternion,
)
from mi_dogsplat.scene.sh_basis import sh_basis_table
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import (
    check_affine,
    decompose_similarity,
    sh_rotation,
    transformed,
)
from splat_scenes import axis_rotation, image_of, random_splats, rasterized, rounded, tilted_camera

ROTATION = axis_rotation([1, -2, 0.7], 2.1)[0]


def similarity(scale=1.7, rotation=ROTATION, translation=(0.4, -3, 2)) -> np.ndarray:
    return affine(scale * rotation, translation)


def camera_after(camera: Camera, matrix: np.ndarray) -> Camera:
    """The camera that sees the moved world as this one sees the world; depths are scaled."""
    rotation, scale, translation = decompose_similarity(matrix)
    turn = camera.w2c[:3, :3] @ rotation.T
    return replace(camera, w2c=affine(turn, scale * camera.w2c[:3, 3] - turn @ translation))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_moved_model_seen_by_a_moved_camera_is_the_same_picture(degree):
    splats, camera, matrix = rounded(random_splats(60, degree=degree)), tilted_camera(), similarity()
    before = image_of(rasterized(splats, camera), camera)
    moved_camera = camera_after(camera, matrix)
    # A scale of 1.7 changes which primitives the near plane takes away: none is that near.
    assert reference.project(splats, camera).depths[reference.project(splats, camera).visible].min() > 0.5
    after = image_of(rasterized(transformed(splats, matrix), moved_camera), moved_camera)
    assert np.abs(after - before).mean() < 2e-5


def test_the_identity_changes_no_array():
    splats = rounded(random_splats(5))
    for name, values in vars(transformed(splats, np.eye(4))).items():
        np.testing.assert_array_equal(values, getattr(splats, name))


@pytest.mark.parametrize(
    ("matrix", "problem"),
    [
        (np.eye(3), "the matrix has shape [3, 3], expected [4, 4]"),
        (None, "the matrix has shape [], expected [4, 4]"),
        ("x", "str is no matrix [4, 4]; that of a transform of Mitsuba is np.array(transform.matrix)"),
    ],
)
def test_what_is_no_matrix_is_called_so(matrix, problem):
    with pytest.raises(ValueError, match=f"^transformed: {re.escape(problem)}$"):
        transformed(rounded(random_splats(2)), matrix)


def test_only_splats_are_moved_also_by_the_identity():
    with pytest.raises(ValueError, match="of the class Model, not Splats; those of a Model are model.splats"):
        transformed(cast(Any, Model(rounded(random_splats(2)))), np.eye(4))


def test_two_transforms_in_turn_are_their_product():
    splats = rounded(random_splats(20))
    a, b = similarity(0.3), similarity(2.0, axis_rotation([0, 1, 0.1], -0.8)[0], (1, 2, 3))
    once, twice = transformed(splats, b @ a), transformed(transformed(splats, a), b)
    for name in ("means", "log_scales", "logit_opacities", "sh_coeffs", "dog_log_scales"):
        np.testing.assert_allclose(getattr(once, name), getattr(twice, name), atol=2e-5, err_msg=name)
    np.testing.assert_allclose(reference.rotations(once.quats), reference.rotations(twice.quats), atol=1e-5)


def test_a_quaternion_of_zero_is_turned_as_the_identity_that_it_stands_for():
    splats = rounded(random_splats(3))
    splats.quats[1] = 0
    turned = reference.rotations(transformed(splats, similarity()).quats.astype(float))
    np.testing.assert_allclose(turned[1], ROTATION, atol=1e-6)
    np.testing.assert_allclose(turned[0], ROTATION @ reference.rotations(splats.quats.astype(float))[0], atol=1e-6)


def test_a_model_without_primitives_can_be_moved():
    assert transformed(Splats.empty(3), similarity()).n_splats == 0


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_turned_coefficients_describe_the_turned_function(degree):
    K = (degree + 1) ** 2
    matrix = sh_rotation(ROTATION, degree)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(K), atol=1e-12)
    rng = np.random.default_rng(0)
    coefficients, directions = rng.normal(size=K), rng.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turned = reference.sh_basis(directions @ ROTATION.T, degree) @ (matrix @ coefficients)
    np.testing.assert_allclose(turned, reference.sh_basis(directions, degree) @ coefficients, atol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_the_basis_on_the_host_is_that_of_the_twin(degree):
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    got, expected = sh_basis_table(directions, degree), reference.sh_basis(directions, degree)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-14)


def test_bands_do_not_mix_under_a_rotation():
    matrix = sh_rotation(ROTATION, 3)
    bands = np.repeat([0, 1, 2, 3], [1, 3, 5, 7])
    np.testing.assert_allclose(matrix[bands[:, None] != bands], 0, atol=1e-12)


def test_quaternions_multiply_and_convert_like_their_matrices():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 50, 4))
    a, b = (q / np.linalg.norm(q, axis=1, keepdims=True) for q in (a, b))
    A, B = reference.rotations(a), reference.rotations(b)
    np.testing.assert_allclose(reference.rotations(quaternion_product(a, b)), A @ B, atol=1e-12)
    np.testing.assert_allclose(rotation_from_quaternion(3 * a), A, atol=1e-12)
    vectors = rng.normal(size=(50, 3))
    np.testing.assert_allclose(rotated(vectors, 3 * a), np.einsum("nij,nj->ni", A, vectors), atol=1e-12)
    np.testing.assert_array_equal(rotated(vectors, np.zeros((50, 4))), vectors)
    np.testing.assert_array_equal(rotation_from_quaternion(np.zeros((1, 4))), np.eye(3)[None])
    np.testing.assert_allclose(reference.rotations(quaternion_from_rotation(A)), A, atol=1e-12)
    for R in [*A, np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, -1, 1]), np.diag([-1.0, 1, -1])]:
        np.testing.assert_allclose(reference.rotations(quaternion_from_rotation(R)[None])[0], R, atol=1e-12)


def test_the_parts_of_a_similarity_are_found_again():
    rotation, scale, translation = decompose_similarity(similarity())
    np.testing.assert_allclose(rotation, ROTATION, atol=1e-12)
    np.testing.assert_allclose(translation, [0.4, -3, 2])
    assert abs(scale - 1.7) < 1e-12


def test_a_mirror_image_is_a_similarity_too():
    isometry, scale, _ = decompose_similarity(similarity(1.7, -ROTATION))
    np.testing.assert_allclose(isometry, -ROTATION, atol=1e-12)
    assert abs(scale - 1.7) < 1e-12


@pytest.mark.parametrize("linear", [np.diag([1.0, 1, 2]), np.diag([2.0, 1, -1]),
                                    np.eye(3) + np.eye(3, k=1) / 2])
def test_shears_and_stretches_are_no_similarities(linear):
    with pytest.raises(ValueError, match="shears or stretches it; load the shape with it"):
        decompose_similarity(similarity(1, linear))


@pytest.mark.parametrize("linear", [np.zeros((3, 3)), np.diag([1.0, 0, 1]), np.ones((3, 3))])
def test_what_collapses_a_model_is_called_so_with_what_to_do(linear):
    for refused in (lambda m: transformed(rounded(random_splats(3)), m), decompose_similarity):
        with pytest.raises(ValueError, match="cannot be flattened: this matrix collapses it.*; give it finite numbers"):
            refused(similarity(1, linear))


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("column", [1, 3])
def test_a_matrix_that_is_not_finite_is_called_so(value, column):
    matrix = similarity()
    matrix[1, column] = value
    with pytest.raises(ValueError, match="a model cannot be moved: this matrix is not finite"):
        decompose_similarity(matrix)
    with pytest.raises(ValueError, match="not finite"):
        transformed(rounded(random_splats(3)), matrix)


@pytest.mark.parametrize("row", [(0, 0, 0, 2), (0, 0, 0.1, 1), (0, 0, 0, 0), (0, np.nan, 0, 1)])
def test_a_matrix_that_projects_is_refused(row):
    matrix = similarity()
    check_affine(matrix)
    matrix[3] = row
    for refused in (lambda: transformed(rounded(random_splats(3)), matrix), lambda: decompose_similarity(matrix)):
        with pytest.raises(ValueError, match="a model cannot be projected: the last row of this matrix is 0, "):
            refused()
