"""Slopes come without a change of the pictures, learn, and go where no pixel shows them."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest
from mi_dogsplat.engine.project import DeviceCamera
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.images.tone_curve import SrgbLog
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.quantisation.quantiser import Quantiser, Tables
from mi_dogsplat.training.strategy.dog_control import DogRule, activate
from mi_dogsplat.training.strategy.slope_activation import SlopeRule, activate_slopes, shown_slopes
from splat_scenes import C0, image_of, kernels, options, random_splats, rasterized, rounded, tilted_camera

CAMERA = tilted_camera()


def model(slope_share: float = 0.0, dog_share: float = 0.5) -> Splats:
    return rounded(random_splats(40, degree=1, dog_share=dog_share, slope_share=slope_share))


def optimizer_of(splats: Splats, curve: SrgbLog | None = None) -> SplatOptimizer:
    return SplatOptimizer(splats, LearningRates(extent=1.0, total_steps=1000), curve)


def image(optimizer: SplatOptimizer) -> np.ndarray:
    return image_of(rasterize(optimizer.params, DeviceCamera.upload(CAMERA), options(model())), CAMERA)


def step(optimizer: SplatOptimizer) -> None:
    r, g, b = rasterize(optimizer.params, DeviceCamera.upload(CAMERA), options(model())).colors
    dr.backward(dr.square(r - 0.2) + dr.square(g - 0.4) + dr.square(b - 0.2))
    optimizer.step()


# --- they come ---


def test_activation_leaves_the_picture_and_then_every_slope_learns():
    optimizer = optimizer_of(model())
    before = image(optimizer)
    assert activate_slopes(optimizer) == optimizer.n_slopes == 40
    np.testing.assert_allclose(image(optimizer), before, rtol=0, atol=1e-7)
    step(optimizer)
    slopes = optimizer.to_splats().color_slopes
    seen = np.unique(np.nonzero(slopes)[0])
    assert len(seen) > 30 and np.abs(slopes).max() == pytest.approx(2.5e-3, rel=1e-3)


def test_slopes_that_are_there_stay_with_their_moments():
    optimizer = optimizer_of(model(slope_share=0.4))
    step(optimizer)
    before, state = optimizer.to_splats(), optimizer.state()
    assert 5 < before.n_slopes < 30
    activate_slopes(optimizer)
    after, m = optimizer.to_splats(), optimizer.state()["color_slopes.m"].reshape(40, 9)
    np.testing.assert_array_equal(after.color_slopes[before.slope_index], before.color_slopes)
    np.testing.assert_array_equal(m[before.slope_index], state["color_slopes.m"].reshape(-1, 9))
    others = np.delete(np.arange(40), before.slope_index)
    assert not after.color_slopes[others].any() and not m[others].any()


def test_a_primitive_becomes_dog_and_gets_slopes_in_either_order():
    models = []
    for order in ((False, True), (True, False)):
        optimizer = optimizer_of(model(slope_share=0.4, dog_share=0.2))
        for with_slopes in order:
            activate_slopes(optimizer) if with_slopes else activate(DogRule(opacity=0.05), optimizer)
        models.append(optimizer.to_splats())
    for name in Splats.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(models[0], name), getattr(models[1], name), err_msg=name)


# --- they go ---


def test_slopes_go_whose_largest_entry_is_below_the_threshold_and_no_others():
    optimizer = optimizer_of(model(slope_share=0.5))
    n, rng = optimizer.n_slopes, np.random.default_rng(0)
    slopes = rng.uniform(-0.99 / 255, 0.99 / 255, (n, 9))
    large = np.arange(n) % 3 == 0
    slopes[large, rng.integers(0, 9, large.sum())] = rng.choice([-1, 1], large.sum()) * 1.01 / 255
    optimizer.assign("color_slopes", slopes)
    np.testing.assert_array_equal(shown_slopes(SlopeRule(), optimizer), large)
    assert shown_slopes(SlopeRule(least=0.0), optimizer).all()
    assert not shown_slopes(SlopeRule(least=0.1), optimizer).any()


def test_what_goes_is_not_seen():
    """One primitive, all its slopes at the threshold with the signs that add up: 1.05 / 255 by the estimate."""
    one = model(dog_share=0).select([3])
    one.means[:], one.logit_opacities[:], one.log_scales[:] = [0, 0, 3], 10, np.log(0.4)
    sloped = replace(one, slope_index=[0], color_slopes=np.full((1, 3, 3), 1 / 255))
    pictures = [image_of(rasterized(splats, CAMERA), CAMERA) for splats in (one, sloped)]
    change = np.abs(pictures[1] - pictures[0]).max() * 255
    assert 0.5 < change < 1.05


def test_slopes_of_linear_colours_are_seen_through_the_curve_of_the_loss():
    splats = model(slope_share=0.5)
    splats.sh_coeffs[:, 0] = (np.where(np.arange(40) % 2, 0.001, 30.0)[:, None] - 0.5) / C0
    splats.color_slopes[:] = 1 / 255 / 2
    shown = shown_slopes(SlopeRule(), optimizer_of(splats, SrgbLog()))
    np.testing.assert_array_equal(shown, splats.slope_index % 2 == 1)  # in the shadows


def test_without_slopes_left_training_runs_the_kernels_of_one_that_never_had_any():
    plain, optimizer = optimizer_of(model()), optimizer_of(model())
    activate_slopes(optimizer)
    step(optimizer)
    optimizer.set_slopes(np.zeros(0, int), np.zeros((0, 3, 3)))
    assert set(optimizer.params) == set(plain.params)
    step(plain)
    assert kernels(lambda: step(optimizer)) == kernels(lambda: step(plain))


@pytest.mark.parametrize(("changes", "words"), [({"start": -1}, "start"), ({"least": -0.1}, "least")])
def test_a_number_out_of_range_is_refused_by_name(changes, words):
    with pytest.raises(ValueError, match=words):
        SlopeRule(**changes)


def test_the_start_scales_with_the_run():
    assert SlopeRule(start=18_000).scaled(7 / 30) == SlopeRule(start=4200)
    assert SlopeRule().scaled(1e-6).start == 1


def test_what_sees_a_model_as_such_a_file_refuses_slopes():
    optimizer, camera = optimizer_of(model(slope_share=0.5)), DeviceCamera.upload(CAMERA)
    with pytest.raises(ValueError, match="Quantiser: spz holds no slopes"):
        Quantiser("spz").before_step(Tables(), optimizer, [camera], options(model()), 0, 10)
