"""Adam on splats: against a NumPy twin, as rows come and go, across checkpoints, without new kernels."""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.parameters import RAW_DOG
from mi_dogsplat.engine.project import NOT_DOG
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.adam import Entry
from mi_dogsplat.training.learning_rates import LearningRates, Refinement
from mi_dogsplat.training.optimizer import SplatOptimizer

RATES = LearningRates(extent=2.0, total_steps=1000)


def random_model(n: int, degree: int = 1, dog_index=(), seed: int = 0) -> Splats:
    rng, m = np.random.default_rng(seed), len(dog_index)
    return Splats(
        rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), rng.normal(size=(n, 4)), rng.normal(size=n),
        rng.normal(size=(n, (degree + 1) ** 2, 3)),
        np.array(dog_index, np.uint32), rng.normal(size=m), rng.normal(size=(m, 3)),
    )  # fmt: skip


def set_gradients(optimizer: SplatOptimizer, rng: np.random.Generator) -> dict[str, np.ndarray]:
    gradients = {}
    for name, value in optimizer.adam.items():
        gradients[name] = rng.normal(size=dr.width(value)).astype(np.float32)
        dr.set_grad(value, mi.Float(gradients[name]))
    return gradients


def run(optimizer: SplatOptimizer, steps: int, seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    for step in range(steps):
        optimizer.schedule(step)
        set_gradients(optimizer, rng)
        optimizer.step()


def moments(optimizer: SplatOptimizer, name: str) -> tuple[np.ndarray, np.ndarray]:
    """First and second moment, [rows, row size]."""
    state = optimizer.state()
    m, v = (state[f"{name}.{key}"].reshape(-1, optimizer.row_size[name]) for key in "mv")
    return m, v


def assert_same(a: Splats, b: Splats):
    for name in a.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@pytest.mark.parametrize("degree", [0, 1, 3])
@pytest.mark.parametrize("dog_index", [(), (1, 4), range(6)])
def test_a_model_goes_in_and_comes_out_unchanged(degree, dog_index):
    model = random_model(6, degree, dog_index)
    assert_same(SplatOptimizer(model, RATES).to_splats(), model)


def test_host_copies_share_no_memory_with_the_device():
    model = random_model(5, dog_index=(2,))
    optimizer = SplatOptimizer(model, RATES)
    before = optimizer.to_splats()
    model.means[:] = 7
    optimizer.numpy("means")[:] = 8
    optimizer.to_splats().logit_opacities[:] = 9
    optimizer.state()["quats"][:] = 10
    assert_same(optimizer.to_splats(), before)


def test_position_steps_decay_log_linearly_and_scale_with_the_extent():
    assert RATES.at(0)["means"] == pytest.approx(2 * 1.6e-4)
    assert RATES.at(500)["means"] == pytest.approx(2 * 1.6e-5)
    assert RATES.at(1000)["means"] == RATES.at(5000)["means"] == pytest.approx(2 * 1.6e-6)
    assert RATES.at(0)["sh_rest"] == RATES.at(1000)["sh_rest"] == pytest.approx(2.5e-3 / 20)


def test_refinement_raises_the_rates_from_its_start_and_lowers_all_but_those_of_positions_linearly_to_its_end():
    refined = replace(RATES, refinement=Refinement(start=600, gain=4.0, end_gain=0.25, means_gain=10.0))
    assert refined.at(599) == RATES.at(599)
    for step, factor in ((600, 4.0), (800, 2.125), (1000, 0.25), (5000, 0.25)):
        plain, got = RATES.at(step), refined.at(step)
        assert got["means"] == pytest.approx(10 * plain["means"])
        others = [name for name in plain if name != "means"]
        assert [got[name] for name in others] == pytest.approx([factor * plain[name] for name in others])
    assert refined.refinement and refined.refinement.scaled(0.5) == Refinement(300, 4.0, 0.25, 10.0)


def test_what_no_render_has_read_yet_is_left_out_of_a_step_and_loses_no_bit_by_it():
    always, later = (SplatOptimizer(random_model(7, 1, (0, 3)), RATES) for _ in range(2))
    for optimizer, unused in ((always, ()), (later, ("sh_rest",))):
        rng, m = np.random.default_rng(2), Entry.of(optimizer.adam, "sh_rest").m
        for step in range(6):
            optimizer.schedule(step)
            set_gradients(optimizer, rng)
            if step < 3:
                dr.clear_grad(optimizer.adam["sh_rest"])
            optimizer.step(unused if step < 3 else ())
            if step < 3:
                assert (Entry.of(optimizer.adam, "sh_rest").m.index == m.index) == bool(unused)  # nothing was written
    expected, got = always.state(), later.state()
    assert list(got) == list(expected) and got["sh_rest.t"] == 6 and np.ptp(got["sh_rest.m"]) > 0
    for name, values in expected.items():
        np.testing.assert_array_equal(got[name], values, err_msg=name)


def test_steps_agree_with_adam_in_float64():
    optimizer, rng = SplatOptimizer(random_model(7, 1, (0, 3)), RATES), np.random.default_rng(5)
    value: dict[str, Any] = {name: optimizer.numpy(name).ravel().astype(np.float64) for name in optimizer.adam}
    m, v = ({name: np.zeros_like(x) for name, x in value.items()} for _ in range(2))
    for step in range(6):
        optimizer.schedule(100 * step)
        gradients = set_gradients(optimizer, rng)
        optimizer.step()
        for name, g in gradients.items():
            m[name] = 0.9 * m[name] + 0.1 * g
            v[name] = 0.999 * v[name] + 0.001 * np.square(np.float64(g))
            unbiased = m[name] / (1 - 0.9 ** (step + 1)), v[name] / (1 - 0.999 ** (step + 1))
            value[name] = value[name] - RATES.at(100 * step)[name] * unbiased[0] / np.sqrt(unbiased[1])
    for name in value:
        trained = optimizer.numpy(name).ravel()
        np.testing.assert_allclose(trained, value[name], rtol=1e-5, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
def test_a_gradient_that_has_no_finite_square_counts_as_zero_and_the_parameter_goes_on(value):
    gradients = np.sin(np.arange(15)).astype(np.float32)
    broken, zeroed = (SplatOptimizer(random_model(5, 0), RATES) for _ in range(2))
    for optimizer, replacement in ((broken, value), (zeroed, 0.0)):
        for step in range(4):
            gradient = gradients.copy()
            if step == 1:
                gradient[4] = replacement
            dr.set_grad(optimizer.adam["means"], mi.Float(gradient))
            optimizer.step()
    assert_same(broken.to_splats(), zeroed.to_splats())
    for name, values in broken.state().items():
        np.testing.assert_array_equal(values, zeroed.state()[name], err_msg=name)
    started = random_model(5, 0).means
    assert np.all(np.abs(broken.to_splats().means - started)[gradients.reshape(5, 3) != 0] > 1e-4)


def test_large_gradients_whose_square_is_finite_are_as_good_as_others():
    tiny, large = (SplatOptimizer(random_model(5, 0), RATES) for _ in range(2))
    for optimizer, size in ((tiny, 1e-3), (large, 1e17)):
        for _ in range(3):
            dr.set_grad(optimizer.adam["means"], mi.Float(size * np.cos(np.arange(15))))
            optimizer.step()
    np.testing.assert_allclose(large.numpy("means"), tiny.numpy("means"), rtol=1e-5)


def test_a_step_launches_no_more_kernels_than_that_of_the_library():
    optimizer = SplatOptimizer(random_model(50, 1, (1, 7)), RATES)

    def kernels_of(step) -> int:
        for value in optimizer.adam.values():
            dr.set_grad(value, dr.opaque(mi.Float, 0.1, dr.width(value)))
        dr.sync_thread()
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            dr.kernel_history_clear()
            step()
            return len(dr.kernel_history([dr.KernelType.JIT]))

    assert kernels_of(optimizer.step) == kernels_of(optimizer.adam.step)


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
    np.testing.assert_array_equal(dog_row, [0, NOT_DOG, 1, NOT_DOG, NOT_DOG])

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
    np.testing.assert_array_equal(row == NOT_DOG, [1, 1, 1, 0, 1, 1, 0])  # at once
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


@pytest.mark.parametrize("kind", ["plain", "dog"])
def test_training_goes_on_from_a_checkpoint_with_the_same_bits(kind, tmp_path):
    straight = SplatOptimizer(random_model(6, 1, (0, 1, 3) if kind == "dog" else ()), RATES)
    run(straight, 3)
    if kind != "plain":
        straight.drop_dog(mi.Bool([False, True, False, False, False, False]))
    np.savez(tmp_path / "state.npz", **straight.state())  # pyright: ignore[reportArgumentType]
    resumed = SplatOptimizer(random_model(2, 1, seed=9), RATES)
    with np.load(tmp_path / "state.npz") as saved:
        resumed.restore(saved)
    for optimizer in (straight, resumed):
        run(optimizer, 3, seed=2)
    expected = straight.state()
    assert resumed.state().keys() == expected.keys()
    for name, value in resumed.state().items():
        np.testing.assert_array_equal(value, expected[name], err_msg=name)
    assert_same(resumed.to_splats(), straight.to_splats())


@pytest.mark.parametrize("degree", [0, 2])
def test_a_checkpoint_of_another_sh_degree_is_refused(degree):
    state = SplatOptimizer(random_model(4, degree), RATES).state()
    with pytest.raises(ValueError, match="sh_rest"):
        SplatOptimizer(random_model(4, 1), RATES).restore(state)


@pytest.mark.parametrize("name", ["means", "quats.m", "sh_rest.v"])
def test_a_checkpoint_that_is_not_finite_is_refused_by_name(name):
    state = SplatOptimizer(random_model(4, 1), RATES).state()
    state[name][3] = np.nan
    with pytest.raises(ValueError, match=rf"{name} of the state is not finite"):
        SplatOptimizer(random_model(4, 1), RATES).restore(state)


def test_no_model_is_left_without_a_primitive():
    with pytest.raises(ValueError, match="no primitive"):
        SplatOptimizer(Splats.empty(0), RATES)
    with pytest.raises(ValueError, match="no primitive"):
        SplatOptimizer(random_model(3), RATES).rearrange(np.array([], int), np.array([], bool))


def test_nothing_is_compiled_after_warm_up_as_rows_rates_and_steps_change():
    optimizer = SplatOptimizer(random_model(50, 2, (1, 7, 11)), RATES)

    def round_of(n: int, step: int):
        optimizer.rearrange(np.arange(n) % optimizer.n, np.arange(n) >= optimizer.n)
        optimizer.assign("logit_opacities", np.minimum(optimizer.numpy("logit_opacities"), 0.5))
        optimizer.reset_moments("logit_opacities")
        for offset in range(3):
            optimizer.schedule(step + offset)
            for value in optimizer.adam.values():
                dr.set_grad(value, dr.opaque(mi.Float, 0.1, dr.width(value)))
            optimizer.step()

    round_of(40, 0)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        for n, step in ((60, 10), (33, 200), (75, 900), (74, 1200)):
            round_of(n, step)
        history = dr.kernel_history([dr.KernelType.JIT])
    assert len(history) > 20
    assert all(kernel["cache_hit"] and not kernel["cache_disk"] for kernel in history)
