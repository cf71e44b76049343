"""Splats: shapes are checked once, activations are exact, selection keeps DoG rows with their primitive."""

import itertools
import re

import numpy as np
import pytest
from mi_dogsplat.scene.splats import Splats


def make(n=6, k=4, dog_index=(1, 2, 5), **changes):
    """A model whose values tell where they came from: row i of everything holds i."""
    row = np.arange(n, dtype=np.float32)
    m = len(dog_index)
    arrays = {
        "means": np.tile(row[:, None], (1, 3)),
        "log_scales": np.tile(row[:, None], (1, 3)),
        "quats": np.tile(row[:, None], (1, 4)),
        "logit_opacities": row,
        "sh_coeffs": np.tile(row[:, None, None], (1, k, 3)),
        "dog_index": np.asarray(dog_index),
        "dog_logit_opacities": np.array(dog_index, dtype=np.float32),
        "dog_log_scales": np.tile(np.array(dog_index, dtype=np.float32).reshape(m, 1), (1, 3)),
    }
    return Splats(**(arrays | changes))


def test_counts_and_degree_follow_from_the_shapes():
    splats = make(n=6, k=9)
    assert (splats.n_splats, splats.n_dog, splats.sh_degree) == (6, 3, 2)
    assert [make(k=k).sh_degree for k in (1, 4, 9, 16)] == [0, 1, 2, 3]


def test_the_dog_part_may_be_left_out():
    plain = make()
    splats = Splats(plain.means, plain.log_scales, plain.quats, plain.logit_opacities, plain.sh_coeffs)
    assert splats.n_dog == 0
    assert splats.dog_scales.shape == (0, 3)
    assert splats.dog_index.dtype == np.uint32


def test_arrays_become_contiguous_float32_and_uint32():
    splats = make(means=np.zeros((3, 6)).T, dog_index=[1, 2, 5])
    assert splats.means.dtype == np.float32 and splats.means.flags.c_contiguous
    assert splats.dog_index.dtype == np.uint32


def test_empty_has_the_degree_asked_for_and_no_primitives():
    for degree in range(4):
        splats = Splats.empty(degree)
        assert (splats.n_splats, splats.n_dog, splats.sh_degree) == (0, 0, degree)
    with pytest.raises(ValueError, match="sh_degree is 4"):
        Splats.empty(4)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("means", np.zeros((6, 2)), '"means" has shape [6, 2], expected [N, 3]'),
        ("log_scales", np.zeros((5, 3)), '"log_scales" has 5 rows, "means" has 6; both need one row'),
        ("quats", np.zeros((6, 3)), '"quats" has shape [6, 3], expected [6, 4]'),
        ("logit_opacities", np.zeros((6, 1)), '"logit_opacities" has shape [6, 1], expected [6]'),
        ("sh_coeffs", np.zeros((6, 5, 3)), '"sh_coeffs" has shape [6, 5, 3], expected [N, 1/4/9/16, 3]'),
        ("sh_coeffs", np.zeros((7, 4, 3)), '"sh_coeffs" has 7 rows, "means" has 6; both need one row'),
        ("dog_log_scales", np.zeros((2, 3)), '"dog_log_scales" has 2 rows, "dog_index" has 3'),
        ("dog_index", np.array([1, 2, 6]), '"dog_index" spans 1 to 6, "means" has 6 rows'),
        ("dog_index", np.array([-1, 2, 3]), '"dog_index" spans -1 to 3, "means" has 6 rows'),
        ("dog_index", np.array([1, 1, 3]), '"dog_index" is not strictly increasing'),
        ("dog_index", np.array([1.0, 2.0, 3.0]), '"dog_index" is float64 [3], expected integers [M]'),
    ],
)
def test_a_mismatch_names_both_sides(name, value, message):
    with pytest.raises(ValueError) as error:
        make(**{name: value})
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        (None, "is an array of object, expected real numbers"),
        ([[None, 0, 0]] * 6, "is an array of object, expected real numbers"),
        ("means.npy", "is an array of <U9, expected real numbers"),
        (np.zeros((6, 3), complex), "is an array of complex128, expected real numbers"),
        ([[0, 0, 0], [0, 0]], "has rows of different lengths"),
    ],
)
def test_what_are_no_real_numbers_is_called_so_by_name(values, problem):
    with pytest.raises(ValueError, match=f'^Splats: "means" {re.escape(problem)}$'):
        make(means=values)


def test_activations_are_exp_and_logistic():
    splats = make()
    x = np.arange(6, dtype=np.float64)
    np.testing.assert_allclose(splats.scales[:, 0], np.exp(x), rtol=1e-6)
    np.testing.assert_allclose(splats.opacities, 1 / (1 + np.exp(-x)), rtol=1e-6)
    np.testing.assert_allclose(splats.dog_scales[:, 2], np.exp([1, 2, 5]), rtol=1e-6)
    np.testing.assert_allclose(splats.dog_opacities, 1 / (1 + np.exp([-1.0, -2.0, -5.0])), rtol=1e-6)


def test_extreme_raw_values_give_limits_without_warnings():
    splats = make(n=2, dog_index=(), logit_opacities=[-1e4, 1e4], log_scales=[[1e4] * 3, [-1e4] * 3])
    assert splats.opacities.tolist() == [0, 1]
    assert splats.scales[:, 0].tolist() == [np.inf, 0]
    faint = make(n=1, dog_index=(), logit_opacities=[-40])
    np.testing.assert_allclose(faint.opacities, np.exp(-40.0), rtol=1e-6)


@pytest.mark.parametrize(
    ("which", "rows", "dog_index"),
    [
        (np.array([True, False, True, False, False, True]), [0, 2, 5], [1, 2]),
        ([5, 0, 2], [5, 0, 2], [0, 2]),  # another order: the DoG rows move along
        ([2, 2, 3, 1], [2, 2, 3, 1], [0, 1, 3]),  # a repeat is a clone, DoG part included
        ([-1], [5], [0]),
        ([0, 3, 4], [0, 3, 4], []),
        ([], [], []),
        (np.zeros(6, dtype=bool), [], []),
    ],
)
def test_selected_primitives_keep_their_own_dog_rows(which, rows, dog_index):
    chosen = make().select(which)
    for name in ("means", "log_scales", "quats"):
        assert getattr(chosen, name)[:, 0].tolist() == rows
    assert chosen.sh_coeffs[:, 3, 2].tolist() == rows
    assert chosen.logit_opacities.tolist() == rows
    assert chosen.dog_index.tolist() == dog_index
    # In this model every DoG row holds the number of the primitive that it was made for.
    assert chosen.dog_logit_opacities.tolist() == chosen.logit_opacities[dog_index].tolist()
    assert chosen.dog_log_scales[:, 1].tolist() == chosen.logit_opacities[dog_index].tolist()


def test_plain_drops_the_pseudo_gaussians_and_keeps_every_primary():
    splats = make()
    plain = splats.plain()
    assert (plain.n_splats, plain.n_dog, splats.n_dog) == (6, 0, 3)
    for name in ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(splats, name))


@pytest.mark.parametrize("dog_index", [(1, 2, 5), (), range(6)])
def test_a_mixture_falls_into_its_dog_and_its_gaussian_primitives(dog_index):
    dog, gaussians = make(dog_index=dog_index).only_dog(), make(dog_index=dog_index).only_gaussians()
    assert dog.means[:, 0].tolist() == list(dog_index)
    assert dog.dog_index.tolist() == list(range(len(dog_index)))
    assert dog.dog_logit_opacities.tolist() == dog.dog_log_scales[:, 0].tolist() == list(dog_index)
    assert gaussians.means[:, 0].tolist() == [i for i in range(6) if i not in dog_index]
    assert gaussians.n_dog == 0


def test_what_a_method_returns_shares_no_memory_with_the_model():
    splats = make()
    of_all = [splats.select(np.ones(6, dtype=bool)), splats.plain(), splats.without_slopes(), splats.without_cuts(),
              splats.uniform_sh(), splats.uniform_sh(3), splats.with_sh_degrees(np.arange(6) % 3), splats.joined(),
              splats.with_sh_degrees(np.ones(6)), splats.with_sh_degrees(np.arange(6) % 3).uniform_sh()]  # fmt: skip
    for chosen in of_all:
        for ours, theirs in itertools.product(vars(chosen).values(), vars(splats).values()):
            assert not np.shares_memory(ours, theirs)


@pytest.mark.parametrize(("which", "shape"), [(3, []), ([[1, 2]], [1, 2]), (np.argwhere(np.ones(6)), [6, 1])])
def test_indices_that_are_no_list_are_refused_with_their_shape(which, shape):
    with pytest.raises(ValueError, match=re.escape(f"Splats.select: indices {shape}, expected [N']; one alone is [i]")):
        make().select(which)


def test_a_wrong_selection_is_refused():
    with pytest.raises(ValueError, match=r'mask \[5\], "means" has 6 rows'):
        make().select(np.ones(5, dtype=bool))
    with pytest.raises(IndexError):
        make().select([6])
