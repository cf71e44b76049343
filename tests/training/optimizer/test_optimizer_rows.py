"""Rows of the optimizer come and go: values, moments and the primitives that are DoG follow them."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.parameters import RAW_DOG
from mi_dogsplat.engine.rows import NO_ROW
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from small_optimizer import RATES, assert_same, moments, random_model, run


def test_rearranged_rows_carry_values_and_moments_and_fresh_ones_start_at_zero():
    optimizer = SplatOptimizer(random_model(9, 1), RATES)
    run(optimizer, 3)
    names = list(optimizer.adam)
    before = {name: (optimizer.numpy(name), *moments(optimizer, name)) for name in names}
    index, fresh = np.array([8, 2, 2, 0, 5, 5]), np.array([0, 0, 1, 0, 1, 1], bool)
    optimizer.rearrange(index, fresh)
    assert optimizer.n == 6
    for name in names:
        value, m, v = before[name]
        np.testing.assert_array_equal(optimizer.numpy(name), value[index])
        for new, old in zip(moments(optimizer, name), (m, v), strict=True):
            np.testing.assert_array_equal(new, np.where(fresh[:, None], 0, old[index]))


def test_removing_rows_does_not_change_how_the_others_train():
    keep = np.array([0, 3, 4, 7])
    small, large = (SplatOptimizer(random_model(8, 0), RATES) for _ in range(2))
    run(small, 2)
    run(large, 2)
    small.rearrange(keep, np.zeros(4, bool))
    for step in range(2, 5):
        for optimizer, rows in ((large, np.arange(8)), (small, keep)):
            optimizer.schedule(step)
            for name, value in optimizer.adam.items():
                size = optimizer.row_size[name]
                gradient = np.sin(np.arange(8 * size) + step).reshape(8, size)[rows]
                dr.set_grad(value, mi.Float(np.float32(gradient).ravel()))
            optimizer.step()
    assert_same(small.to_splats(), large.to_splats().select(keep))


def test_a_number_that_is_learned_beside_moves_along_and_leaves_no_trace():
    model = random_model(6)
    optimizer, plain = SplatOptimizer(model, RATES), SplatOptimizer(model, RATES)
    optimizer.learn("mask", np.arange(6.0), 0.01)
    optimizer.learn("held", np.arange(6.0), 0.0)
    run(plain, 3)
    rng, other = np.random.default_rng(1), np.random.default_rng(2)
    for step in range(3):
        optimizer.schedule(step)
        for name, value in optimizer.adam.items():
            source = rng if name in plain.adam else other
            dr.set_grad(value, mi.Float(source.normal(size=dr.width(value)).astype(np.float32)))
        optimizer.step()
    assert_same(optimizer.to_splats(), plain.to_splats())
    mask, state = optimizer.numpy("mask"), optimizer.state()
    assert 0.001 < np.abs(mask - np.arange(6)).max() <= 0.03001
    np.testing.assert_array_equal(optimizer.numpy("held"), np.arange(6))
    optimizer.rearrange(np.array([4, 1]), np.zeros(2, bool))
    np.testing.assert_array_equal(optimizer.numpy("mask"), mask[[4, 1]])
    np.testing.assert_array_equal(optimizer.state()["mask.m"], state["mask.m"][[4, 1]])
    for name in ("mask", "held"):
        optimizer.forget(name)
    optimizer.schedule(4)
    assert list(optimizer.adam) == list(plain.adam) and optimizer.row_size == plain.row_size


def test_dog_rows_follow_their_primitives_and_fresh_copies_are_plain():
    model = random_model(8, 0, (1, 4, 6))
    optimizer = SplatOptimizer(model, RATES)
    run(optimizer, 2)
    before, (m, _) = optimizer.to_splats(), moments(optimizer, "dog_log_scales")
    index, fresh = np.array([6, 0, 4, 3, 4]), np.array([0, 0, 0, 0, 1], bool)
    optimizer.rearrange(index, fresh)  # 1 goes, 6 comes before 4, the copy of 4 is plain
    after = optimizer.to_splats()
    np.testing.assert_array_equal(after.dog_index, [0, 2])
    np.testing.assert_array_equal(after.dog_log_scales, before.dog_log_scales[[2, 1]])
    np.testing.assert_array_equal(after.dog_logit_opacities, before.dog_logit_opacities[[2, 1]])
    np.testing.assert_array_equal(moments(optimizer, "dog_log_scales")[0], m[[2, 1]])
    dog_row = optimizer.params["dog_row"].numpy()
    np.testing.assert_array_equal(dog_row, [0, NO_ROW, 1, NO_ROW, NO_ROW])

    optimizer.rearrange(np.array([1, 3]), np.zeros(2, bool))
    assert optimizer.n_dog == 0 and not any(name.startswith("dog") for name in optimizer.params)
    run(optimizer, 1)


def test_choosing_dog_primitives_keeps_the_moments_of_those_that_stay():
    optimizer = SplatOptimizer(random_model(6, 0), RATES)
    optimizer.set_dog(np.array([0, 2, 5]), np.full(3, -1.0), np.arange(9.0).reshape(3, 3))
    assert optimizer.to_splats().n_dog == 3
    run(optimizer, 2)
    kept, m = optimizer.to_splats(), moments(optimizer, "dog_log_scales")[0]
    optimizer.set_dog(np.array([2, 3]), np.append(kept.dog_logit_opacities[1], 0.5), np.zeros((2, 3)))
    after = optimizer.to_splats()
    np.testing.assert_array_equal(after.dog_index, [2, 3])
    np.testing.assert_array_equal(after.dog_logit_opacities, [kept.dog_logit_opacities[1], 0.5])
    np.testing.assert_array_equal(moments(optimizer, "dog_log_scales")[0], [m[1], np.zeros(3)])
    run(optimizer, 1)
    assert not np.array_equal(optimizer.numpy("dog_log_scales"), np.zeros((2, 3)))  # it has a learning rate
    optimizer.set_dog(np.array([]), np.array([]), np.zeros((0, 3)))
    assert optimizer.to_splats().n_dog == 0 and "dog_row" not in optimizer.params


def test_dropped_dog_rows_go_and_the_others_lose_no_bit():
    optimizer = SplatOptimizer(random_model(7, 0), RATES)
    optimizer.set_dog(np.array([0, 2, 3, 6]), np.arange(4), np.linspace(0.1, 1, 12).reshape(4, 3))
    run(optimizer, 2)
    before = {name: (optimizer.numpy(name), *moments(optimizer, name)) for name in RAW_DOG}
    optimizer.drop_dog(mi.Bool([True, True, True, False, True, True, False]))
    row = optimizer.params["dog_row"].numpy()
    np.testing.assert_array_equal(row == NO_ROW, [1, 1, 1, 0, 1, 1, 0])  # at once
    assert optimizer.n_dog == 2
    np.testing.assert_array_equal(optimizer.params["dog_index"].numpy(), [3, 6])
    np.testing.assert_array_equal(optimizer.params["dog_row"].numpy()[[3, 6]], [0, 1])
    for name, old in before.items():
        new = (optimizer.numpy(name), *moments(optimizer, name))
        for a, b in zip(new, old, strict=True):
            np.testing.assert_array_equal(a, b[2:])
    run(optimizer, 1)
    optimizer.drop_dog(dr.full(mi.Bool, True, 7))
    assert optimizer.n_dog == 0 and not any(name.startswith("dog") for name in optimizer.params)
    run(optimizer, 1)


@pytest.mark.parametrize("ask", ["to_splats", "state", "rearrange", "set_dog"])
def test_whoever_asks_first_after_a_drop_sees_it(ask):
    optimizer = SplatOptimizer(random_model(5, 0, (0, 2, 4)), RATES)
    run(optimizer, 1)
    kept = optimizer.to_splats()
    optimizer.drop_dog(mi.Bool([True, False, False, False, False]))
    if ask == "state":
        np.testing.assert_array_equal(optimizer.state()["dog_index"], [2, 4])
    elif ask == "rearrange":
        optimizer.rearrange(np.array([4, 0, 2]), np.zeros(3, bool))
        np.testing.assert_array_equal(optimizer.to_splats().dog_index, [0, 2])
        np.testing.assert_array_equal(optimizer.to_splats().dog_log_scales, kept.dog_log_scales[[2, 1]])
    elif ask == "set_dog":
        m = moments(optimizer, "dog_log_scales")[0]
        optimizer.drop_dog(mi.Bool([False, False, True, False, False]))
        optimizer.set_dog(np.array([2, 4]), np.zeros(2), np.zeros((2, 3)))
        np.testing.assert_array_equal(moments(optimizer, "dog_log_scales")[0], [np.zeros(3), m[1]])
    else:
        np.testing.assert_array_equal(optimizer.to_splats().dog_index, [2, 4])
        np.testing.assert_array_equal(optimizer.to_splats().dog_log_scales, kept.dog_log_scales[1:])


def test_setting_rows_keeps_the_others_and_the_moments():
    optimizer = SplatOptimizer(random_model(5, 0), RATES)
    run(optimizer, 2)
    old, m = optimizer.numpy("log_scales"), moments(optimizer, "log_scales")[0]
    optimizer.assign("log_scales", np.zeros((2, 3)), np.array([1, 3]))
    np.testing.assert_array_equal(optimizer.numpy("log_scales")[[1, 3]], 0)
    np.testing.assert_array_equal(optimizer.numpy("log_scales")[[0, 2, 4]], old[[0, 2, 4]])
    np.testing.assert_array_equal(moments(optimizer, "log_scales")[0], m)
    optimizer.reset_moments("log_scales")
    assert not any(x.any() for x in moments(optimizer, "log_scales"))
    assert optimizer.state()["log_scales.t"] == 2


def test_no_model_is_left_without_a_primitive():
    with pytest.raises(ValueError, match="no primitive"):
        SplatOptimizer(Splats.empty(0), RATES)
    with pytest.raises(ValueError, match="no primitive"):
        SplatOptimizer(random_model(3), RATES).rearrange(np.array([], int), np.array([], bool))
