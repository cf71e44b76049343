"""Slopes and curvatures go where no pixel shows them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.images.tone_curve import SrgbLog
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.slope_activation import SlopeRule, shown_slopes
from own_axes_models import CURVED, SLOPED, Kind
from row_kinds import of_each
from splat_scenes import C0, image_of, random_splats, rasterized, rounded, tilted_camera

CAMERA = tilted_camera()


EACH = of_each(SLOPED, CURVED)


def model(kind: Kind | None = None, dog_share: float = 0.5) -> Splats:
    """Half of the primitives have rows of the kind."""
    shares: dict[str, Any] = {kind.share: 0.5} if kind else {}
    return rounded(random_splats(40, degree=1, dog_share=dog_share, **shares))


def optimizer_of(splats: Splats, curve: SrgbLog | None = None) -> SplatOptimizer:
    return SplatOptimizer(splats, LearningRates(extent=1.0, total_steps=1000), curve)


@EACH
def test_rows_go_whose_largest_entry_is_below_the_threshold_and_no_others(kind: Kind):
    optimizer = optimizer_of(model(kind))
    n, size, rng = len(optimizer.index_of(kind.group)), optimizer.row_size[kind.name], np.random.default_rng(0)
    rows = rng.uniform(-0.99 / 255, 0.99 / 255, (n, size))
    large = np.arange(n) % 3 == 0
    rows[large, rng.integers(0, size, large.sum())] = rng.choice([-1, 1], large.sum()) * 1.01 / 255
    optimizer.assign(kind.name, rows)
    np.testing.assert_array_equal(shown_slopes(SlopeRule(), optimizer, kind.group), large)
    assert shown_slopes(SlopeRule(least=0.0), optimizer, kind.group).all()
    assert not shown_slopes(SlopeRule(least=0.1), optimizer, kind.group).any()


@pytest.mark.parametrize(("kind", "most"), [(SLOPED, 1.05), (CURVED, 1.1)], ids=["slopes", "curvatures"])
def test_what_goes_is_not_seen(kind: Kind, most):
    """One primitive, all its entries at the threshold with the signs that add up: ``most`` / 255 by the estimate."""
    one = model(dog_share=0).select([3])
    one.means[:], one.logit_opacities[:], one.log_scales[:] = [0, 0, 3], 10, np.log(0.4)
    some = replace(one, **{kind.group.index: [0], kind.name: np.full((1, *kind.shape), 1 / 255)})
    pictures = [image_of(rasterized(splats, CAMERA), CAMERA) for splats in (one, some)]
    change = np.abs(pictures[1] - pictures[0]).max() * 255
    assert 0.5 < change < most


@EACH
def test_those_of_linear_colours_are_seen_through_the_curve_of_the_loss(kind: Kind):
    splats = model(kind)
    splats.sh_coeffs[:, 0] = (np.where(np.arange(40) % 2, 0.001, 30.0)[:, None] - 0.5) / C0
    kind.values(splats)[:] = 1 / 255 / 2
    shown = shown_slopes(SlopeRule(), optimizer_of(splats, SrgbLog()), kind.group)
    np.testing.assert_array_equal(shown, kind.index(splats) % 2 == 1)  # in the shadows
