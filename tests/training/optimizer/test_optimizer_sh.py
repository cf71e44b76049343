"""Adam on primitives with SH degrees of their own: groups of rows that move between degrees with their moments."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.sh_groups import ROW_COEFFICIENTS
from mi_dogsplat.scene.row_groups import SH
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.optimizer.adam import Entry
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.broken import broken
from mi_dogsplat.viewer.source import splats_of_state
from small_optimizer import (
    RATES,
    alike,
    assert_nothing_is_compiled,
    assert_same,
    assert_same_state,
    random_model,
    state_from_file,
)

DEGREES = np.array([3, 0, 1, 2, 0, 3, 1])
N = len(DEGREES)
MOMENTS = ("", ".m", ".v")


def uniform(degree=3, dog_index=(0, 3)) -> Splats:
    return random_model(N, degree, dog_index)


def mixed(degrees=DEGREES) -> Splats:
    return uniform().with_sh_degrees(degrees)


def gradients(seed: int) -> np.ndarray:
    """[N, 16, 3] of all bands, in proportion to what is no power of ten."""
    return np.random.default_rng(seed).normal(size=(N, 16, 3)).astype(np.float32)


def step(optimizer: SplatOptimizer, seed: int) -> None:
    """One with the same gradients for the same coefficients, in whichever arrays they are."""
    whole = gradients(seed)
    degrees = optimizer.sh_degrees
    for name, value in optimizer.adam.items():
        if name == "sh_rest":
            δ = whole[:, : optimizer.row_size[name] // 3]
        elif name in optimizer.bands:
            degree = int(name[2])
            k = (degree + 1) ** 2
            δ = np.zeros((np.sum(degrees == degree), ROW_COEFFICIENTS[degree], 3), np.float32)
            δ[:, : k - 1] = whole[degrees == degree, 1:k]
        else:
            δ = np.random.default_rng(seed).normal(size=dr.width(value)).astype(np.float32)
        dr.set_grad(value, mi.Float(δ.ravel()))
    optimizer.schedule(seed)
    optimizer.step()


def bands(optimizer: SplatOptimizer, of: str = "") -> np.ndarray:
    """[N, 16, 3] of values or moments, zero where there are none; the constant coefficient left out."""
    state, whole = optimizer.state(), np.zeros((N, 16, 3), np.float32)
    if "sh_rest" in state:
        rest = state[f"sh_rest{of}"].reshape(N, -1, 3)
        whole[:, 1 : rest.shape[1]] = rest[:, 1:]
    for degree, group in SH.items():
        (name,) = group.names
        if name in state:
            rows = state[f"{name}{of}"].reshape(-1, ROW_COEFFICIENTS[degree], 3)
            k = (degree + 1) ** 2
            whole[state[group.index], 1:k] = rows[:, : k - 1]
            assert not rows[:, k - 1 :].any()  # padding stays zero
    return whole


def kept(degrees: np.ndarray) -> np.ndarray:
    """[N, 16, 1] the coefficients above the constant one that primitives of these degrees have."""
    mask = np.arange(16) < (np.asarray(degrees)[:, None] + 1) ** 2
    mask[:, 0] = False
    return mask[:, :, None]


def test_a_mixed_model_goes_in_and_comes_out_unchanged():
    optimizer = SplatOptimizer(mixed(), RATES)
    assert_same(optimizer.to_splats(), mixed())
    assert optimizer.sh_degree == 3 and optimizer.sh_degrees.tolist() == DEGREES.tolist()
    assert optimizer.bands == ("sh1_coeffs", "sh2_coeffs", "sh3_coeffs")
    expected = upload(mixed())
    for name in (*optimizer.bands, *(group.index for group in SH.values())):
        np.testing.assert_array_equal(optimizer.params[name].numpy(), expected[name].numpy(), err_msg=name)


def test_it_holds_no_float_for_bands_that_are_not_there():
    held = sum(dr.width(value) for value in SplatOptimizer(mixed(), RATES).adam.values())
    assert held == 14 * N + 2 * 4 + 3 * (2 * 4 + 1 * 8 + 2 * 16)  # DoG rows; padded rows of three groups


def test_groups_learn_at_the_rate_of_the_rest():
    rates = RATES.at(500)
    assert rates["sh1_coeffs"] == rates["sh2_coeffs"] == rates["sh3_coeffs"] == rates["sh_rest"]
    optimizer = SplatOptimizer(mixed(), RATES)
    optimizer.rate_factors["sh_rest"] = 2.0
    optimizer.schedule(500)
    assert float(Entry.of(optimizer.adam, "sh2_coeffs").rate) == pytest.approx(2 * rates["sh_rest"])


def test_a_mixed_model_takes_the_steps_that_a_uniform_one_takes_with_the_bands_that_it_has():
    whole, grouped = SplatOptimizer(uniform(), RATES), SplatOptimizer(mixed(), RATES)
    for seed in range(4):
        step(whole, seed)
        step(grouped, seed)
    for of in MOMENTS:
        np.testing.assert_array_equal(bands(grouped, of), bands(whole, of) * kept(DEGREES), err_msg=of)
    np.testing.assert_array_equal(grouped.numpy("sh_dc"), whole.numpy("sh_dc"))


@pytest.mark.parametrize("after", [DEGREES, [0, 3, 2, 1, 0, 1, 3], [0] * N, [1] * N, [3] * N, [0, 0, 2, 0, 0, 0, 0]])
@pytest.mark.parametrize("before", ["uniform", "mixed"])
def test_bands_that_stay_keep_value_moments_and_step_count_and_new_ones_are_zero(before, after):
    optimizer = SplatOptimizer(uniform() if before == "uniform" else mixed(), RATES)
    for seed in range(3):
        step(optimizer, seed)
    old, model = [bands(optimizer, of) for of in MOMENTS], optimizer.to_splats()
    optimizer.set_sh_degrees(np.asarray(after))
    assert_same(optimizer.to_splats(), model.with_sh_degrees(after))
    for of, values in zip(MOMENTS, old, strict=True):
        np.testing.assert_array_equal(bands(optimizer, of), values * kept(after), err_msg=of)
    assert all(optimizer.state()[f"{name}.t"] == 3 for name in optimizer.bands)
    step(optimizer, 3)
    changed = bands(optimizer) != old[0] * kept(after)
    assert np.array_equal(changed, np.broadcast_to(kept(after), changed.shape))  # all of them learn


def test_bands_where_there_were_none_begin_as_new_parameters():
    optimizer = SplatOptimizer(uniform(degree=0), RATES)
    step(optimizer, 0)
    optimizer.set_sh_degrees(np.array([0, 1, 0, 0, 0, 0, 0]))
    assert optimizer.state()["sh1_coeffs.t"] == 0 and not bands(optimizer).any()
    step(optimizer, 1)
    np.testing.assert_allclose(np.abs(bands(optimizer)[1, 1:4]), RATES.sh_rest, rtol=1e-4)  # Adam's first step


@pytest.mark.parametrize("degrees", [[0, 1], [4] * N])
def test_what_is_no_degree_changes_nothing(degrees):
    optimizer = SplatOptimizer(mixed(), RATES)
    with pytest.raises(ValueError, match="with_sh_degrees"):
        optimizer.set_sh_degrees(np.asarray(degrees))
    assert_same(optimizer.to_splats(), mixed())
    step(optimizer, 0)


def test_rows_that_are_copied_or_removed_take_their_groups_along():
    optimizer = SplatOptimizer(mixed(), RATES)
    step(optimizer, 0)
    model, state = optimizer.to_splats(), optimizer.state()
    index, fresh = np.array([5, 1, 5, 2, 3]), np.array([False, False, True, False, False])
    optimizer.rearrange(index, fresh)
    expected = model.select(index)
    got = optimizer.to_splats()
    for name in ("means", "sh_coeffs", "sh1_index", "sh1_coeffs", "sh2_index", "sh2_coeffs", "sh3_index", "sh3_coeffs"):
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name), err_msg=name)
    m = state["sh3_coeffs.m"].reshape(2, -1)
    np.testing.assert_array_equal(optimizer.state()["sh3_coeffs.m"].reshape(2, -1), [m[1], 0 * m[1]])
    optimizer.rearrange(np.array([1, 4]), np.zeros(2, bool))
    assert optimizer.bands == ("sh2_coeffs",) and optimizer.sh_degree == 2
    optimizer.keep(np.array([0]))
    assert optimizer.bands == () and optimizer.to_splats().sh_degree == 0
    optimizer.restore(state)
    assert_same(optimizer.to_splats(), model)


@pytest.mark.parametrize("change", [None, DEGREES[::-1], [0] * N, [2] * N], ids=str)
def test_training_goes_on_from_a_checkpoint_with_the_same_bits(tmp_path, change):
    straight = SplatOptimizer(mixed() if change is None else uniform(), RATES)
    step(straight, 0)
    if change is not None:
        straight.set_sh_degrees(np.asarray(change))
    step(straight, 1)
    resumed, saved = SplatOptimizer(uniform(), RATES), state_from_file(straight, tmp_path)
    resumed.restore(saved)
    of_run = {f"optimizer.{name}": values for name, values in saved.items()}
    assert_same(splats_of_state(of_run), straight.to_splats())
    for optimizer in (straight, resumed):
        step(optimizer, 2)
    assert_same_state(resumed, straight)


@pytest.mark.parametrize("name", ["sh1_coeffs", "sh3_coeffs"])
def test_a_checkpoint_whose_groups_lack_rows_is_refused(name):
    state = SplatOptimizer(mixed(), RATES).state()
    state[name] = state[name][:-3]
    with pytest.raises(ValueError, match=name):
        SplatOptimizer(uniform(), RATES).restore(state)


def test_a_checkpoint_of_groups_whose_common_bands_are_of_no_degree_is_refused():
    state = SplatOptimizer(mixed(), RATES).state() | {"sh_rest": np.zeros(7, np.float32)}
    with pytest.raises(ValueError, match=r"\['sh_rest'\] of the state does not fit this SH degree"):
        SplatOptimizer(uniform(), RATES).restore(state)


def test_a_checkpoint_of_a_uniform_model_still_has_to_fit():
    with pytest.raises(ValueError, match="does not fit this SH degree"):
        SplatOptimizer(mixed(), RATES).restore(SplatOptimizer(uniform(2), RATES).state())


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e4])
def test_a_primitive_whose_own_bands_are_broken_is_found(value):
    model = mixed()
    model.sh2_coeffs[0, 5, 1] = value
    model.sh3_coeffs[1, 14, 2] = value
    assert np.flatnonzero(broken(SplatOptimizer(model, RATES), 2.0)).tolist() == [3, 5]
    assert not broken(SplatOptimizer(mixed(), RATES), 2.0).any()


def test_nothing_is_compiled_after_warm_up_as_rows_of_groups_come_and_go():
    optimizer = SplatOptimizer(uniform().select(np.arange(50) % N), RATES)
    optimizer.set_sh_degrees(np.resize([0, 0, 1, 3, 0], 50))  # no group as long as another array: one kernel for both

    def round_of(n: int, first: int) -> None:
        optimizer.rearrange(np.arange(n) % optimizer.n, np.arange(n) >= optimizer.n)
        alike(optimizer, first)

    assert_nothing_is_compiled(round_of)
