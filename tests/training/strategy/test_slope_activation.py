"""Slopes go where no pixel shows them."""

from dataclasses import replace

import numpy as np
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.images.tone_curve import SrgbLog
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.slope_activation import SlopeRule, shown_slopes
from splat_scenes import C0, image_of, random_splats, rasterized, rounded, tilted_camera

CAMERA = tilted_camera()


def model(slope_share: float = 0.0, dog_share: float = 0.5) -> Splats:
    return rounded(random_splats(40, degree=1, dog_share=dog_share, slope_share=slope_share))


def optimizer_of(splats: Splats, curve: SrgbLog | None = None) -> SplatOptimizer:
    return SplatOptimizer(splats, LearningRates(extent=1.0, total_steps=1000), curve)


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
