"""Shifts come without a change of the pictures, and go where no pixel shows them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.scene.row_groups import SHIFTS
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.given_rows import GIVEN
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.row_activation import RowActivation, RowControl
from mi_dogsplat.training.strategy.shift_activation import ShiftRule, shown_shifts
from same_numbers import assert_same_numbers
from shifted_models import with_shifts
from splat_scenes import (
    SMOOTH_OPTIONS,
    image_of,
    make_camera,
    make_splats,
    random_splats,
    rasterized,
    rounded,
    tilted_camera,
)

CAMERAS = [tilted_camera(), make_camera()]


def optimizer_of(splats: Splats) -> SplatOptimizer:
    return SplatOptimizer(splats, LearningRates(extent=1.0, total_steps=1000))


def activated(splats: Splats) -> SplatOptimizer:
    optimizer, positions = optimizer_of(splats), np.array([camera.position for camera in CAMERAS])
    t: Any = SimpleNamespace(optimizer=optimizer, photographs=SimpleNamespace(positions=positions))
    (event,) = RowActivation(GIVEN["shifts"], ShiftRule()).act(t)
    assert event.record == {"kind": "shifts_activated", "count": optimizer.n}
    return optimizer


def test_they_begin_at_the_mean_view_of_the_training_and_move_nothing():
    splats = rounded(random_splats(40, degree=1))
    optimizer = activated(splats)
    given = optimizer.to_splats()
    assert given.n_shifts == 40 and not given.view_shifts.any()
    offsets = np.array([splats.means - camera.position for camera in CAMERAS])
    views = (offsets / np.linalg.norm(offsets, axis=2, keepdims=True)).mean(axis=0)
    axes = reference.rotations(splats.quats.astype(np.float64))
    np.testing.assert_allclose(given.mean_views, np.einsum("nxa,nx->na", axes, views), atol=1e-6)
    for camera in CAMERAS:
        before, after = (image_of(rasterized(s, camera), camera) for s in (splats, given))
        assert_same_numbers(before, after)


def one(size: float, opacity: float = 0.9, **dog) -> Splats:
    """A white primitive that moves by ``size`` standard deviations across the picture, from its mean view."""
    splats = make_splats([[0, 0, 3]], 0.3, opacity, 1.0, **dog)
    splats.shift_index, splats.mean_views = np.array([0]), np.array([[0, 0, -1.0]])
    splats.view_shifts = np.array([[[0, 0, size / 2], [0, 0, 0], [0, 0, 0]]])
    return rounded(splats)


def change_of_picture(splats: Splats) -> float:
    camera = make_camera(96, 96, 90.0)
    pictures = [image_of(rasterized(s, camera, **SMOOTH_OPTIONS), camera) for s in (splats, splats.without_shifts())]
    return float(np.abs(pictures[0] - pictures[1]).max())


@pytest.mark.parametrize("opacity", [0.9, 0.3])
@pytest.mark.parametrize("dog", [{}, {"dog": [0], "f_a": 0.6, "F": 0.5}, {"dog": [0], "f_a": 0.8, "F": 1.6}],
                         ids=["Gaussian", "narrow DoG", "wide DoG"])  # fmt: skip
def test_what_goes_changes_no_pixel_by_a_255th_and_what_is_some_times_that_shows(opacity, dog):
    sizes = np.geomspace(1e-4, 2, 60)
    models = [one(size, opacity, **dog) for size in sizes]
    shown = [bool(shown_shifts(ShiftRule(), optimizer_of(splats), SHIFTS)[0]) for splats in models]
    first = shown.index(True)
    assert 0 < first < 59 and all(shown[first:])
    assert change_of_picture(models[first - 1]) < 1 / 255
    assert change_of_picture(one(4 * sizes[first], opacity, **dog)) > 1 / 255


def test_who_shows_is_decided_by_the_bound_on_the_change_of_both_kernels():
    """One by one: shifts from 0 to so large that each kernel changes by all of its peak."""
    splats = with_shifts(rounded(random_splats(40, seed=5, degree=0, dog_share=0.5)), every=1)
    splats.view_shifts *= np.geomspace(1e-3, 30, 40)[:, None, None]
    dog = dict(zip(splats.dog_index.tolist(), range(splats.n_dog), strict=True))
    steepest, bounds = np.exp(-0.5), []
    for i in range(40):
        reach = np.linalg.svd(splats.view_shifts[i])[1][0] * (1 + np.sqrt((splats.mean_views[i] ** 2).sum()))
        bound = min(steepest * reach, 1)
        if i in dog:
            height = 1 / (1 + np.exp(-splats.dog_logit_opacities[dog[i]]))
            bound += height * min(steepest * reach / np.exp(splats.dog_log_scales[dog[i]]).min(), 1)
        bounds.append(bound / (1 + np.exp(-splats.logit_opacities[i])))
    optimizer, places = optimizer_of(splats), np.sort(bounds)
    for least in 0.5 * (places[1:] + places[:-1]):
        np.testing.assert_array_equal(shown_shifts(ShiftRule(least=least), optimizer, SHIFTS), bounds >= least)


def test_the_end_leaves_out_what_no_pixel_shows():
    splats = with_shifts(rounded(make_splats(np.random.default_rng(0).normal(size=(6, 3)), 0.3, 0.9)), every=1)
    splats.view_shifts[[0, 2, 4]] *= 1e-3
    optimizer = optimizer_of(splats)
    t: Any = SimpleNamespace(optimizer=optimizer)
    control = RowControl(GIVEN["shifts"], ShiftRule())
    (event,) = control.end(t, None)
    assert event.record == {"kind": "shifts_left_out", "count": 3, "left": 3}
    assert event.text == "shifts left out: 3, kept: 3"
    left = optimizer.to_splats()
    assert left.shift_index.tolist() == [1, 3, 5]
    np.testing.assert_array_equal(left.view_shifts, splats.view_shifts[[1, 3, 5]])
    np.testing.assert_array_equal(left.mean_views, splats.mean_views[[1, 3, 5]])
    assert control.end(t, None) == []
