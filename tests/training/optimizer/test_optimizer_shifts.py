"""Shifts in the optimizer: two arrays whose rows go together, one that is trained and one that stays."""

import numpy as np
import pytest
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rows import NO_ROW
from mi_dogsplat.scene.row_groups import SHIFTS
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.broken import broken
from small_optimizer import RATES, assert_same, assert_same_state, moments, random_model, run, state_from_file


def optimizer_of(index=(1, 4, 6), n: int = 8) -> SplatOptimizer:
    return SplatOptimizer(random_model(n, 1, (0, 4), rows={"shift_index": index}), RATES)


def test_a_model_with_shifts_goes_in_and_comes_out_unchanged():
    model = random_model(6, 1, (1, 4), rows={"shift_index": (0, 3), "cut_index": (3, 5)})
    optimizer = SplatOptimizer(model, RATES)
    assert_same(optimizer.to_splats(), model)
    assert optimizer.n_shifts == 2
    params, expected = optimizer.params, upload(model)
    for name in ("shift_index", "shift_row", "view_shifts", "mean_views"):
        np.testing.assert_array_equal(params[name].numpy(), expected[name].numpy(), err_msg=name)


def test_moves_are_trained_as_scales_are_and_mean_views_stay_to_the_bit():
    optimizer = optimizer_of()
    before = optimizer.to_splats()
    run(optimizer, 3)
    after = optimizer.to_splats()
    assert (after.view_shifts != before.view_shifts).all()
    np.testing.assert_array_equal(after.mean_views, before.mean_views)
    rates = RATES.at(0)
    assert rates["view_shifts"] == rates["log_scales"] and rates["mean_views"] == 0


def test_both_arrays_follow_their_primitives():
    optimizer = optimizer_of()
    run(optimizer, 2)
    before, (m, v) = optimizer.to_splats(), moments(optimizer, "view_shifts")
    optimizer.rearrange(np.array([6, 0, 4, 3, 4]), np.array([0, 0, 0, 0, 1], bool))
    after = optimizer.to_splats()
    assert after.shift_index.tolist() == [0, 2]
    for name in SHIFTS.names:
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name)[[2, 1]])
    for new, old in zip(moments(optimizer, "view_shifts"), (m, v), strict=True):
        np.testing.assert_array_equal(new, old[[2, 1]])
    np.testing.assert_array_equal(optimizer.params["shift_row"].numpy(), [0, NO_ROW, 1, NO_ROW, NO_ROW])
    optimizer.keep(np.array([1, 3]))
    assert optimizer.n_shifts == 0 and not {"view_shifts", "mean_views"} & set(optimizer.params)


def test_training_goes_on_from_a_state_with_the_same_bits(tmp_path):
    straight = optimizer_of()
    run(straight, 3)
    resumed = SplatOptimizer(random_model(2, 1, seed=9), RATES)
    resumed.restore(state_from_file(straight, tmp_path))
    for optimizer in (straight, resumed):
        run(optimizer, 3, seed=2)
    assert_same_state(resumed, straight)


@pytest.mark.parametrize("name", SHIFTS.names)
def test_a_state_that_lacks_rows_is_refused(name):
    state = optimizer_of().state()
    state[name] = state[name][:3]
    with pytest.raises(ValueError, match=f"{name}.* does not fit its 3 rows of shift_index"):
        optimizer_of().restore(state)


@pytest.mark.parametrize("name", SHIFTS.names)
def test_a_primitive_with_a_value_that_is_not_finite_is_broken(name):
    optimizer = optimizer_of()
    rows = optimizer.numpy(name)
    rows[1, 2] = np.nan
    optimizer.assign(name, rows)
    assert np.flatnonzero(broken(optimizer, 2.0)).tolist() == [4]
