"""Slopes, curvatures, cuts and shifts in the optimizer: rows of some, which follow their primitives with moments."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rows import NO_ROW
from mi_dogsplat.scene.row_groups import (
    BESIDE_DOG,
    CURVATURES,
    CUTS,
    OWN_AXES,
    PLANES,
    SECOND_CUTS,
    SHIFTS,
    SLOPES,
    RowGroup,
)
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.training.images.tone_curve import SrgbLog
from mi_dogsplat.training.optimizer.adam import Entry
from mi_dogsplat.training.optimizer.learning_rates import Refinement
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.broken import MAX_COLOR, MAX_NORMAL, broken
from mi_dogsplat.viewer.source import splats_of_state
from small_optimizer import RATES, assert_same, assert_same_state, moments, random_model, run, state_from_file

EACH_KIND = pytest.mark.parametrize("group", BESIDE_DOG, ids=lambda group: group.index)


def name_of(group: RowGroup) -> str:
    """Of what is trained; the mean views of shifts, a second array, stay."""
    return group.names[0]


def rows_of(group: RowGroup, values) -> np.ndarray:
    return np.asarray(values).reshape(-1, *group.arrays[name_of(group)])


def params_of(group: RowGroup) -> set[str]:
    return {*group.names, group.index, group.row}


def optimizer_of(group: RowGroup, index=(1, 4, 6), n: int = 8, degree: int = 1) -> SplatOptimizer:
    return SplatOptimizer(random_model(n, degree, (0, 4), rows={group.index: index}), RATES)


@EACH_KIND
@pytest.mark.parametrize("degree", [0, 2])
@pytest.mark.parametrize("dog_index", [(), (1, 4)])
@pytest.mark.parametrize("index", [(3,), (1, 4), range(6)])
def test_a_model_with_rows_goes_in_and_comes_out_unchanged(group, degree, dog_index, index):
    model = random_model(6, degree, dog_index, rows={group.index: index})
    optimizer = SplatOptimizer(model, RATES)
    assert_same(optimizer.to_splats(), model)
    assert optimizer.n_dog == model.n_dog
    assert optimizer.index_of(group).tolist() == list(index)


def test_rows_of_one_model_do_not_mix():
    rows = {"slope_index": (0, 3), "cut_index": (3, 4, 5), "second_cut_index": (2, 3), "shift_index": (2, 4)}
    model = random_model(6, 1, (1, 4), rows=rows)
    optimizer = SplatOptimizer(model, RATES)
    run(optimizer, 1)
    optimizer.keep(np.array([5, 3, 2]))
    after = optimizer.to_splats()
    assert (after.slope_index.tolist(), after.cut_index.tolist()) == ([1], [0, 1])
    assert (after.second_cut_index.tolist(), after.shift_index.tolist()) == ([1, 2], [2])
    optimizer.set_rows(SLOPES, np.array([], int), {})
    assert_same(optimizer.to_splats(), after.without_slopes())
    optimizer.set_rows(SECOND_CUTS, np.array([], int), {})
    assert_same(optimizer.to_splats(), after.without_slopes().without_second_cuts())
    optimizer.set_rows(CUTS, np.array([], int), {})
    assert_same(optimizer.to_splats(), after.without_slopes().without_cuts())


@EACH_KIND
def test_renders_get_the_arrays_of_an_upload_and_none_without_rows(group):
    model = random_model(6, 0, (2,), rows={group.index: (0, 3)})
    params, expected = SplatOptimizer(model, RATES).params, upload(model)
    for name in params_of(group):
        np.testing.assert_array_equal(params[name].numpy(), expected[name].numpy(), err_msg=name)
    assert not params_of(group) & set(SplatOptimizer(random_model(6, 0, (2,)), RATES).params)


@EACH_KIND
def test_rows_follow_their_primitives_and_fresh_copies_have_none(group):
    optimizer, name = optimizer_of(group), name_of(group)
    run(optimizer, 2)
    before, (m, v) = optimizer.to_splats(), moments(optimizer, name)
    index, fresh = np.array([6, 0, 4, 3, 4]), np.array([0, 0, 0, 0, 1], bool)
    optimizer.rearrange(index, fresh)  # 1 goes, 6 comes before 4, the copy of 4 is whole and in one colour
    after = optimizer.to_splats()
    assert getattr(after, group.index).tolist() == [0, 2] and after.dog_index.tolist() == [1, 2]
    for of_group in group.names:
        np.testing.assert_array_equal(getattr(after, of_group), getattr(before, of_group)[[2, 1]])
    for new, old in zip(moments(optimizer, name), (m, v), strict=True):
        np.testing.assert_array_equal(new, old[[2, 1]])
        assert np.ptp(new) > 0
    np.testing.assert_array_equal(optimizer.params[group.row].numpy(), [0, NO_ROW, 1, NO_ROW, NO_ROW])
    optimizer.keep(np.array([1, 3]))
    assert len(optimizer.index_of(group)) == 0 and not params_of(group) & set(optimizer.params)
    run(optimizer, 1)


@EACH_KIND
def test_dropping_dog_rows_leaves_the_others_alone(group):
    optimizer = optimizer_of(group)
    before = optimizer.to_splats()
    optimizer.drop_dog(dr.full(mi.Bool, True, 8))
    assert_same(optimizer.to_splats(), before.plain())


@EACH_KIND
def test_choosing_primitives_keeps_the_moments_of_those_that_stay(group):
    optimizer, name = optimizer_of(group, ()), name_of(group)
    zeros = rows_of(group, np.zeros((3, optimizer_of(group).row_size[name])))

    def give(index: np.ndarray, values: np.ndarray) -> None:
        beside = {other: np.zeros((len(index), *shape)) for other, shape in group.arrays.items()}
        optimizer.set_rows(group, index, beside | {name: values})

    give(np.array([0, 2, 5]), zeros)
    run(optimizer, 2)
    kept, (m, v) = optimizer.numpy(name), moments(optimizer, name)
    assert np.all(kept != 0)  # it has a learning rate
    rows = rows_of(group, [kept[1], np.full_like(kept[1], 0.5)])
    give(np.array([2, 3]), rows)
    np.testing.assert_array_equal(getattr(optimizer.to_splats(), name), rows)
    for new, old in zip(moments(optimizer, name), (m, v), strict=True):
        np.testing.assert_array_equal(new, [old[1], np.zeros_like(old[1])])
    give(np.array([], int), zeros[:0])
    assert not len(optimizer.index_of(group)) and not params_of(group) & set(optimizer.params)


def test_shifts_are_trained_as_scales_are_and_mean_views_stay_to_the_bit():
    optimizer = optimizer_of(SHIFTS)
    before = optimizer.to_splats()
    run(optimizer, 3)
    after = optimizer.to_splats()
    assert (after.view_shifts != before.view_shifts).all()
    np.testing.assert_array_equal(after.mean_views, before.mean_views)
    rates = RATES.at(0)
    assert rates["view_shifts"] == rates["log_scales"] and rates["mean_views"] == 0


@pytest.mark.parametrize("group", OWN_AXES, ids=lambda group: group.index)
@pytest.mark.parametrize("step", [0, 600, 800, 1000])
def test_steps_have_all_factors_of_those_of_the_constant_colour(group, step):
    refinement = Refinement(600, gain=4.0, end_gain=0.1, means_gain=16.0, sh_gain=4.0)
    rates = replace(RATES, refinement=refinement, views=300)
    times, name = 25 if group in PLANES else 1, name_of(group)
    assert rates.at(step, 5)[name] == pytest.approx(times * rates.at(step, 5)["sh_dc"])
    optimizer = SplatOptimizer(random_model(4, 0, rows={group.index: (1,)}), rates)
    optimizer.schedule(step)
    assert float(Entry.of(optimizer.adam, name).rate) == pytest.approx(rates.at(step)[name])


@EACH_KIND
def test_training_goes_on_from_a_state_with_the_same_bits(group, tmp_path):
    straight = optimizer_of(group)
    run(straight, 3)
    resumed, saved = SplatOptimizer(random_model(2, 1, seed=9), RATES), state_from_file(straight, tmp_path)
    resumed.restore(saved)
    of_run = {f"optimizer.{name}": values for name, values in saved.items()}
    assert_same(splats_of_state(of_run), straight.to_splats())
    for optimizer in (straight, resumed):
        run(optimizer, 3, seed=2)
    assert_same_state(resumed, straight)
    assert resumed.state()[f"{name_of(group)}.t"] == 6
    assert resumed.learned == set()


@EACH_KIND
def test_a_state_without_rows_says_nothing_of_them_and_takes_those_that_there_were(group):
    plain, optimizer = optimizer_of(group, ()), optimizer_of(group)
    state = plain.state()
    assert not [name for name in state if name.startswith((group.index, *group.names))]
    optimizer.restore(state)
    assert_same(optimizer.to_splats(), plain.to_splats())
    optimizer.schedule(5)
    run(optimizer, 1)


@EACH_KIND
def test_a_state_whose_rows_are_not_those_of_its_index_is_refused(group):
    state = optimizer_of(group).state()
    wrong = [(name, state | {name: state[name][: len(state[name]) // 3]}) for name in group.names]
    without_index = {name: values for name, values in state.items() if name != group.index}
    for name, changed in (*wrong, (name_of(group), without_index)):
        with pytest.raises(ValueError, match=f"{name}.* does not fit its . rows of {group.index}"):
            optimizer_of(group).restore(changed)


@EACH_KIND
@pytest.mark.parametrize("value", [np.nan, -np.inf, 1.001, -1.001])
def test_a_primitive_whose_rows_no_step_repairs_is_broken_and_no_other(group, value):
    optimizer = optimizer_of(group)
    limit = MAX_NORMAL if group in PLANES else MAX_COLOR
    for name in group.names:
        for bound in (value, 0.999):
            rows = optimizer.numpy(name)
            rows[1, -1] = bound * limit
            optimizer.assign(name, rows)
            is_broken = bound is value and (group is not SHIFTS or not np.isfinite(value))  # shifts have no limit
            assert np.flatnonzero(broken(optimizer, 2.0)).tolist() == ([4] if is_broken else [])


def change_of_equal_gradients(group: RowGroup) -> np.ndarray:
    """By how much rows [2, …] change in a step, of primitives in the shadows and of a lamp."""
    model = random_model(3, 0, rows={group.index: (0, 2)})
    model.sh_coeffs[[0, 2], 0] = (np.array([0.01, 20.0])[:, None] - 0.5) / C0
    optimizer = SplatOptimizer(model, RATES, SrgbLog())
    for value in optimizer.adam.values():
        dr.set_grad(value, dr.full(mi.Float, 1.0, dr.width(value)))
    optimizer.step()
    return getattr(model, name_of(group)) - getattr(optimizer.to_splats(), name_of(group))


def test_slopes_of_linear_colours_change_in_proportion_to_what_the_curve_shows_of_their_primitive():
    """A step of Adam is as long as its rate on the curve; in radiance it is divided by the slope there."""
    slopes = SrgbLog().slope(mi.Float(0.01, 20.0)).numpy()
    expected = np.broadcast_to(2.5e-3 / slopes[:, None, None], (2, 3, 3))
    np.testing.assert_allclose(change_of_equal_gradients(SLOPES), expected, rtol=1e-3)


def test_curvatures_of_linear_colours_change_as_the_curve_shows_all_channels_in_the_mean():
    slopes = SrgbLog().slope(mi.Float(0.01, 20.0)).numpy()  # of a grey primitive, the same in each
    expected = np.broadcast_to(2.5e-3 / slopes[:, None], (2, 6))
    np.testing.assert_allclose(change_of_equal_gradients(CURVATURES), expected, rtol=1e-3)


@pytest.mark.parametrize("plane", [CUTS, SECOND_CUTS], ids=["first", "second"])
def test_cuts_of_linear_colours_change_as_those_of_others(plane):
    np.testing.assert_allclose(change_of_equal_gradients(plane), np.full((2, 3), 0.0625), rtol=1e-3)
