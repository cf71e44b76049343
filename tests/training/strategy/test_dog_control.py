"""3D-DoG in training: activation, and density control against float64; what is dropped costs nothing any more."""

import dataclasses
from typing import Any

import drjit as dr
import numpy as np
import pytest
from launches import KernelWatch
from mi_dogsplat import write_ply
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import RAW_DOG
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.dog_control import DogRule, activate, degenerate
from splat_scenes import image_of, kernels, logit, options, random_splats, rasterized, rounded, tilted_camera

RULE = DogRule()
FAINT = logit(1e-4)  # f_a that makes any pseudo-Gaussian invisible
CAMERA = tilted_camera()


def mixture(n: int = 40, dog_share: float = 0.5) -> Splats:
    """In front of ``CAMERA``, SH degree 1, some opacities and f_a near the threshold."""
    return rounded(random_splats(n, degree=1, dog_share=dog_share))


def optimizer_of(splats: Splats) -> SplatOptimizer:
    return SplatOptimizer(splats, LearningRates(extent=1.0, total_steps=1000))


def image(optimizer: SplatOptimizer) -> np.ndarray:
    """Seen with the parameters as they are on the device now: nothing here asks how many DoG there are."""
    params = {name: dr.detach(value) for name, value in optimizer.params.items()}
    return image_of(rasterize(params, DeviceCamera.upload(CAMERA), options(mixture())), CAMERA)


def train(optimizer: SplatOptimizer, steps: int = 1) -> None:
    camera = DeviceCamera.upload(CAMERA)
    for _ in range(steps):
        r, g, b = rasterize(optimizer.params, camera, options(mixture())).colors
        dr.backward(dr.square(r - 0.2) + dr.square(g - 0.2) + dr.square(b - 0.2))
        optimizer.step()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"opacity": 0.0}, "opacity"),
        ({"opacity": 1.0}, "opacity"),
        ({"scale": 0.0}, "F > 0"),
        ({"scale": (1.6, float("nan"))}, "F > 0"),
        ({"min_opacity": 0.0}, "min_opacity"),
        ({"start": -1}, "start"),
    ],
)
def test_a_number_out_of_range_is_refused_by_name(changes, message):
    with pytest.raises(ValueError, match=message):
        DogRule(**changes)


def test_the_start_scales_with_the_run():
    assert RULE.scaled(7 / 30) == dataclasses.replace(RULE, start=5833)
    assert RULE.scaled(1e-6).start == 1


def test_activation_makes_every_primitive_dog():
    optimizer = optimizer_of(mixture(dog_share=0))
    train(optimizer)
    before = optimizer.to_splats()
    rule = DogRule(opacity=0.05, scale=1.3)
    assert activate(rule, optimizer) == optimizer.n_dog == 40
    after = optimizer.to_splats()
    np.testing.assert_allclose(after.dog_opacities, 0.05, rtol=1e-6)
    np.testing.assert_allclose(after.dog_scales, 1.3, rtol=1e-6)
    np.testing.assert_array_equal(after.means, before.means)
    train(optimizer)
    trained = optimizer.to_splats()
    assert np.mean(trained.dog_scales != after.dog_scales) > 0.5
    assert np.mean(trained.dog_opacities != after.dog_opacities) > 0.5


def test_primitives_take_turns_between_several_scales():
    optimizer = optimizer_of(mixture(7, dog_share=0))
    activate(DogRule(scale=(1.6, 0.6)), optimizer)
    expected = np.tile(np.array([1.6, 0.6] * 4)[:7, None], 3)
    np.testing.assert_allclose(optimizer.to_splats().dog_scales, expected, rtol=1e-6)


def test_activation_leaves_alone_what_is_dog_already():
    splats = mixture()
    optimizer = optimizer_of(splats)
    activate(DogRule(opacity=0.05, scale=0.6), optimizer)
    after, was_dog = optimizer.to_splats(), np.isin(np.arange(40), splats.dog_index)
    np.testing.assert_array_equal(after.dog_log_scales[was_dog], splats.dog_log_scales)
    np.testing.assert_array_equal(after.dog_logit_opacities[was_dog], splats.dog_logit_opacities)
    np.testing.assert_allclose(after.dog_scales[~was_dog], 0.6, rtol=1e-6)


@pytest.mark.parametrize("min_opacity", [1 / 255, 0.1])
def test_pseudo_gaussians_below_the_threshold_degenerate_and_no_others(min_opacity):
    rng, n = np.random.default_rng(0), 500
    splats = rounded(random_splats(n, degree=0, dog_share=0.7))
    splats.logit_opacities[:], m = rng.normal(-2, 3, n), splats.n_dog
    optimizer = optimizer_of(splats)
    logits = rng.normal(-2, 3, m).astype(np.float32)
    optimizer.set_dog(splats.dog_index, logits, rng.uniform(0.1, 1, (m, 3)))

    a, f_a = (1 / (1 + np.exp(-np.float64(x))) for x in (splats.logit_opacities[splats.dog_index], logits))
    shown = a * f_a >= min_opacity
    assert 0.1 < shown.mean() < 0.9
    degenerate(DogRule(min_opacity=min_opacity), optimizer)
    np.testing.assert_array_equal(optimizer.to_splats().dog_index, splats.dog_index[shown])
    np.testing.assert_array_equal(optimizer.to_splats().dog_logit_opacities, logits[shown])
    degenerate(DogRule(min_opacity=min_opacity), optimizer)
    assert optimizer.n_dog == shown.sum()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 40.0])
@pytest.mark.parametrize("name", RAW_DOG)
def test_a_pseudo_gaussian_that_is_not_finite_degenerates_before_it_harms_its_primary(name, value):
    optimizer = optimizer_of(mixture())
    activate(DogRule(scale=1.3), optimizer)
    values = optimizer.numpy(name)
    values.reshape(40, -1)[[3, 17], -1] = value
    optimizer.assign(name, values)
    degenerate(DogRule(min_opacity=1e-30), optimizer)
    train(optimizer)
    after = optimizer.to_splats()
    harmless = name == "dog_logit_opacities" and value > 0  # f_a = 1
    assert after.n_dog == (40 if harmless else 38)
    assert harmless or not np.isin([3, 17], after.dog_index).any()
    for field in dataclasses.fields(Splats):
        if field.name != "dog_logit_opacities" or np.isfinite(value):
            assert np.isfinite(getattr(after, field.name)).all()


def test_what_counts_is_the_scale_of_the_pseudo_gaussian_not_the_factor():
    optimizer = optimizer_of(mixture())
    activate(RULE, optimizer)
    log_scales, log_factors = optimizer.numpy("log_scales"), optimizer.numpy("dog_log_scales")
    log_scales[[5, 6], 2], log_factors[[5, 7], 2] = 12, 3
    optimizer.assign("log_scales", log_scales)
    optimizer.assign("dog_log_scales", log_factors)
    degenerate(DogRule(min_opacity=1e-30), optimizer)
    np.testing.assert_array_equal(optimizer.to_splats().dog_index, np.delete(np.arange(40), 5))


def test_without_control_nothing_degenerates():
    optimizer = optimizer_of(mixture())
    activate(RULE, optimizer)
    optimizer.assign("dog_logit_opacities", np.full(40, FAINT))
    degenerate(DogRule(control=False), optimizer)
    assert optimizer.n_dog == 40
    degenerate(RULE, optimizer)
    assert optimizer.n_dog == 0


def test_what_degenerates_is_drawn_as_a_plain_gaussian_at_once_and_stays_one():
    optimizer = optimizer_of(mixture(dog_share=0))
    activate(DogRule(opacity=0.5, scale=1.6), optimizer)
    logits = optimizer.numpy("dog_logit_opacities")
    faded = np.arange(40) % 3 > 0
    optimizer.assign("dog_logit_opacities", np.where(faded, FAINT, logits))
    degenerate(RULE, optimizer)
    optimizer.assign("dog_logit_opacities", logits)  # risen again, but too late
    degenerate(RULE, optimizer)
    drawn = image(optimizer)
    assert np.abs(drawn - image(optimizer_of(mixture(dog_share=0)))).max() > 0.05  # some are DoG

    rest = optimizer.to_splats()
    np.testing.assert_array_equal(rest.dog_index, np.flatnonzero(~faded))
    np.testing.assert_array_equal(image_of(rasterized(rest, CAMERA), CAMERA), drawn)


def test_a_degenerate_primitive_takes_neither_file_nor_memory_nor_tiles(tmp_path):
    optimizer = optimizer_of(mixture(dog_share=0))
    activate(DogRule(opacity=0.5, scale=2.5), optimizer)

    def costs() -> tuple[int, int, list[int]]:
        """Bytes of the file, tile entries, entries of each DoG array and its moments."""
        splats, state = optimizer.to_splats(), optimizer.state()
        write_ply(tmp_path / "model.ply", splats)
        lists: Any = rasterized(splats, CAMERA).lists
        arrays = [f"{name}{moment}" for name in RAW_DOG for moment in ("", ".m", ".v")]
        entries = [len(state[name]) for name in arrays if name in state]
        return (tmp_path / "model.ply").stat().st_size, dr.width(lists.splat_from_isect), entries

    def fade(first: int) -> None:
        values = optimizer.numpy("dog_logit_opacities")
        values[first:] = FAINT
        optimizer.assign("dog_logit_opacities", values)
        degenerate(RULE, optimizer)

    all_dog = costs()
    fade(25)
    some_dog = costs()
    fade(0)
    no_dog = costs()
    assert [entries for *_, entries in (all_dog, some_dog, no_dog)] == [3 * [40] + 3 * [120], 3 * [25] + 3 * [75], []]
    assert all_dog[0] - some_dog[0] == 15 * 20  # an index and four floats
    assert all_dog[1] > some_dog[1] > no_dog[1]

    optimizer = optimizer_of(mixture(dog_share=0))  # one that never was DoG
    after = (tmp_path / "model.ply").read_bytes()
    assert costs() == no_dog and (tmp_path / "model.ply").read_bytes() == after


def test_without_dog_left_training_runs_the_kernels_of_plain_gaussians():
    plain, optimizer = optimizer_of(mixture(dog_share=0)), optimizer_of(mixture(dog_share=0))
    activate(RULE, optimizer)
    train(optimizer)
    optimizer.assign("dog_logit_opacities", np.full(40, FAINT))
    degenerate(RULE, optimizer)
    assert optimizer.n_dog == 0 and set(optimizer.params) == set(plain.params)

    def step(optimizer):
        train(optimizer)
        degenerate(RULE, optimizer)

    step(plain)
    assert kernels(lambda: step(optimizer)) == kernels(lambda: step(plain))


def test_a_call_launches_one_kernel():
    optimizer = optimizer_of(mixture())
    activate(RULE, optimizer)
    train(optimizer)
    dr.eval(*optimizer.params.values())
    dr.sync_thread()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        degenerate(RULE, optimizer)
        history = dr.kernel_history([dr.KernelType.JIT])
    assert [kernel["size"] for kernel in history] == [40]


def test_no_kernel_is_compiled_while_primitives_degenerate():
    optimizer = optimizer_of(mixture(200, dog_share=0))
    activate(DogRule(), optimizer)
    left = iter((190, 150, 120, 77, 64, 31, 8, 3))

    def step():
        values = optimizer.numpy("dog_logit_opacities")
        values[next(left) :] = FAINT
        optimizer.assign("dog_logit_opacities", values)
        degenerate(RULE, optimizer)
        train(optimizer)
        return optimizer.n_dog

    with KernelWatch() as kernels:
        counts = [step(), step()]
        kernels.forget()
        counts += [step() for _ in range(6)]
    assert counts == sorted(set(counts), reverse=True) and kernels.launched > 100
    assert not kernels.new


def test_a_model_without_dog_is_left_alone():
    optimizer = optimizer_of(mixture(dog_share=0))
    assert kernels(lambda: degenerate(RULE, optimizer)) == set() and optimizer.n_dog == 0
