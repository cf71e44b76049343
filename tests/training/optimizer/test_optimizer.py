"""Adam on splats: against a NumPy twin, as rows come and go, across checkpoints, without new kernels."""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.training.optimizer.adam import Entry
from mi_dogsplat.training.optimizer.learning_rates import Refinement
from mi_dogsplat.training.optimizer.sh_rows import SH_INDEX
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from small_optimizer import (
    RATES,
    alike,
    assert_nothing_is_compiled,
    assert_same,
    assert_same_state,
    random_model,
    run,
    set_gradients,
    state_from_file,
)


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


def test_position_steps_fall_with_the_root_of_the_number_of_primitives_from_some_number_on():
    plain = replace(RATES, refinement=Refinement(start=600, gain=4.0, end_gain=0.25, means_gain=10.0))
    assert plain.refinement
    rates = replace(plain, refinement=replace(plain.refinement, few=900))
    assert plain.at(700, 3600) == plain.at(700) == rates.at(700)
    for n, factor in ((1, 1), (900, 1), (3600, 1 / 2), (90_000, 1 / 10)):
        assert rates.at(700, n) == pytest.approx(plain.at(700) | {"means": factor * plain.at(700)["means"]})
        assert rates.at(599, n) == RATES.at(599)


@pytest.mark.parametrize("views, factor", [(1, 1), (50, 1), (75, 1.5), (200, 4), (1000, 4)])
def test_view_dependent_colour_is_refined_in_larger_steps_where_views_are_many(views, factor):
    plain = replace(RATES, refinement=Refinement(start=600, gain=4.0, end_gain=0.25, means_gain=10.0), views=views)
    assert plain.refinement
    rates = replace(plain, refinement=replace(plain.refinement, sh_gain=4.0))
    assert rates.at(599) == plain.at(599) == RATES.at(599)
    for step in (600, 800, 1000):
        usual, got = plain.at(step), rates.at(step)
        for name in usual:
            expected = factor * usual[name] if name in ("sh_rest", *SH_INDEX) else usual[name]
            assert got[name] == pytest.approx(expected), name


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


@pytest.mark.parametrize("kind", ["plain", "dog"])
def test_training_goes_on_from_a_checkpoint_with_the_same_bits(kind, tmp_path):
    straight = SplatOptimizer(random_model(6, 1, (0, 1, 3) if kind == "dog" else ()), RATES)
    run(straight, 3)
    if kind != "plain":
        straight.drop_dog(mi.Bool([False, True, False, False, False, False]))
    resumed = SplatOptimizer(random_model(2, 1, seed=9), RATES)
    resumed.restore(state_from_file(straight, tmp_path))
    for optimizer in (straight, resumed):
        run(optimizer, 3, seed=2)
    assert_same_state(resumed, straight)


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


def test_nothing_is_compiled_after_warm_up_as_rows_rates_and_steps_change():
    optimizer = SplatOptimizer(random_model(50, 2, (1, 7, 11)), RATES)

    def round_of(n: int, step: int) -> None:
        optimizer.rearrange(np.arange(n) % optimizer.n, np.arange(n) >= optimizer.n)
        optimizer.assign("logit_opacities", np.minimum(optimizer.numpy("logit_opacities"), 0.5))
        optimizer.reset_moments("logit_opacities")
        alike(optimizer, step)

    assert_nothing_is_compiled(round_of)
