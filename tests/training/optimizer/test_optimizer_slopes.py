"""Slopes in the optimizer: rows of some primitives, which follow them with their moments whatever moves rows."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import NO_ROW
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.training.images.tone_curve import SrgbLog
from mi_dogsplat.training.optimizer.adam import Entry
from mi_dogsplat.training.optimizer.learning_rates import Refinement
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.broken import MAX_COLOR, broken
from mi_dogsplat.viewer.source import splats_of_state
from small_optimizer import RATES, assert_same, assert_same_state, moments, random_model, run, state_from_file

NAMES = ("color_slopes", "slope_index", "slope_row")


def optimizer_of(slope_index=(1, 4, 6), dog_index=(0, 4), n: int = 8, degree: int = 1) -> SplatOptimizer:
    return SplatOptimizer(random_model(n, degree, dog_index, slope_index=slope_index), RATES)


@pytest.mark.parametrize("degree", [0, 2])
@pytest.mark.parametrize("dog_index", [(), (1, 4)])
@pytest.mark.parametrize("slope_index", [(3,), (1, 4), range(6)])
def test_a_model_with_slopes_goes_in_and_comes_out_unchanged(degree, dog_index, slope_index):
    model = random_model(6, degree, dog_index, slope_index=slope_index)
    optimizer = SplatOptimizer(model, RATES)
    assert_same(optimizer.to_splats(), model)
    assert optimizer.n_slopes == len(slope_index) and optimizer.slope_index.tolist() == list(slope_index)


def test_renders_get_the_arrays_of_an_upload_and_none_without_slopes():
    model = random_model(6, 0, (2,), slope_index=(0, 3))
    params, expected = SplatOptimizer(model, RATES).params, upload(model)
    for name in NAMES:
        np.testing.assert_array_equal(params[name].numpy(), expected[name].numpy(), err_msg=name)
    assert not set(NAMES) & set(SplatOptimizer(random_model(6, 0, (2,)), RATES).params)


def test_rows_follow_their_primitives_and_fresh_copies_have_none():
    optimizer = optimizer_of()
    run(optimizer, 2)
    before, (m, v) = optimizer.to_splats(), moments(optimizer, "color_slopes")
    index, fresh = np.array([6, 0, 4, 3, 4]), np.array([0, 0, 0, 0, 1], bool)
    optimizer.rearrange(index, fresh)  # 1 goes, 6 comes before 4, the copy of 4 is in one colour
    after = optimizer.to_splats()
    assert after.slope_index.tolist() == [0, 2] and after.dog_index.tolist() == [1, 2]
    np.testing.assert_array_equal(after.color_slopes, before.color_slopes[[2, 1]])
    for new, old in zip(moments(optimizer, "color_slopes"), (m, v), strict=True):
        np.testing.assert_array_equal(new, old[[2, 1]])
        assert np.ptp(new) > 0
    np.testing.assert_array_equal(optimizer.params["slope_row"].numpy(), [0, NO_ROW, 1, NO_ROW, NO_ROW])
    optimizer.keep(np.array([1, 3]))
    assert optimizer.n_slopes == 0 and not set(NAMES) & set(optimizer.params)
    run(optimizer, 1)


def test_dropping_dog_rows_leaves_slopes_alone():
    optimizer = optimizer_of()
    before = optimizer.to_splats()
    optimizer.drop_dog(dr.full(mi.Bool, True, 8))
    assert_same(optimizer.to_splats(), before.plain())


def test_choosing_primitives_keeps_the_moments_of_those_that_stay():
    optimizer = optimizer_of(())
    optimizer.set_slopes(np.array([0, 2, 5]), np.zeros((3, 3, 3)))
    run(optimizer, 2)
    kept, (m, v) = optimizer.numpy("color_slopes"), moments(optimizer, "color_slopes")
    assert np.all(kept != 0)  # it has a learning rate
    slopes = np.stack([kept[1].reshape(3, 3), np.full((3, 3), 0.5)])
    optimizer.set_slopes(np.array([2, 3]), slopes)
    np.testing.assert_array_equal(optimizer.to_splats().color_slopes, slopes)
    for new, old in zip(moments(optimizer, "color_slopes"), (m, v), strict=True):
        np.testing.assert_array_equal(new, [old[1], np.zeros(9)])
    optimizer.set_slopes(np.array([], int), np.zeros((0, 3, 3)))
    assert optimizer.to_splats().n_slopes == 0 and not set(NAMES) & set(optimizer.params)


def test_steps_are_those_of_the_constant_colour_with_all_factors_on_it():
    refinement = Refinement(600, gain=4.0, end_gain=0.1, means_gain=16.0, sh_gain=4.0)
    refined = replace(RATES, refinement=refinement, views=300)
    for step in (0, 600, 800, 1000):
        rates = refined.at(step, 5)
        assert rates["color_slopes"] == rates["sh_dc"]
    optimizer = SplatOptimizer(random_model(4, 0, slope_index=(1,)), refined)
    optimizer.schedule(600)
    assert float(Entry.of(optimizer.adam, "color_slopes").rate) == pytest.approx(4 * 2.5e-3)


def test_training_goes_on_from_a_state_with_the_same_bits(tmp_path):
    straight = optimizer_of()
    run(straight, 3)
    resumed, saved = SplatOptimizer(random_model(2, 1, seed=9), RATES), state_from_file(straight, tmp_path)
    resumed.restore(saved)
    of_run = {f"optimizer.{name}": values for name, values in saved.items()}
    assert_same(splats_of_state(of_run), straight.to_splats())
    for optimizer in (straight, resumed):
        run(optimizer, 3, seed=2)
    assert_same_state(resumed, straight)
    assert resumed.state()["color_slopes.t"] == 6
    assert resumed.learned == set()


def test_a_state_without_slopes_says_nothing_of_them_and_takes_those_that_there_were():
    plain, optimizer = optimizer_of(()), optimizer_of()
    state = plain.state()
    assert not [name for name in state if "slope" in name]
    optimizer.restore(state)
    assert_same(optimizer.to_splats(), plain.to_splats())
    optimizer.schedule(5)
    run(optimizer, 1)


@pytest.mark.parametrize("change", ["index", "rows"])
def test_a_state_whose_rows_are_not_those_of_its_index_is_refused(change):
    state = optimizer_of().state()
    if change == "index":
        del state["slope_index"]
    else:
        state["color_slopes"] = state["color_slopes"][:9]
    with pytest.raises(ValueError, match="color_slopes.* does not fit its . rows of slope_index"):
        optimizer_of().restore(state)


@pytest.mark.parametrize("value", [np.nan, -np.inf, 1.001 * MAX_COLOR, -1.001 * MAX_COLOR])
def test_a_primitive_whose_slopes_no_step_repairs_is_broken_and_no_other(value):
    optimizer = optimizer_of()
    for bound in (value, 0.999 * MAX_COLOR):
        slopes = optimizer.numpy("color_slopes")
        slopes[1, 8] = bound
        optimizer.assign("color_slopes", slopes)
        assert np.flatnonzero(broken(optimizer, 2.0)).tolist() == ([4] if bound is value else [])


def test_slopes_of_linear_colours_change_in_proportion_to_what_the_curve_shows_of_their_primitive():
    """A step of Adam is as long as its rate on the curve; in radiance it is divided by the slope there."""
    model = random_model(3, 0, slope_index=(0, 2))
    model.sh_coeffs[[0, 2], 0] = (np.array([0.01, 20.0])[:, None] - 0.5) / C0
    optimizer = SplatOptimizer(model, RATES, SrgbLog())
    for value in optimizer.adam.values():
        dr.set_grad(value, dr.full(mi.Float, 1.0, dr.width(value)))
    optimizer.step()
    change = model.color_slopes - optimizer.to_splats().color_slopes
    slopes = SrgbLog().slope(mi.Float(0.01, 20.0)).numpy()
    np.testing.assert_allclose(change, np.broadcast_to(2.5e-3 / slopes[:, None, None], (2, 3, 3)), rtol=1e-3)
