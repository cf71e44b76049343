"""Cuts go where no pixel shows them: what a cut may change of α, against its formula and against pictures."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.given_rows import GIVEN
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.cut_activation import CutRule, largest_change, shown_cuts
from mi_dogsplat.training.strategy.row_activation import RowControl
from own_axes_models import CUT, EACH_PLANE, Kind
from splat_scenes import SMOOTH_OPTIONS, image_of, make_camera, make_splats, rasterized, rounded

CAMERA = make_camera(96, 96, 90.0)
STEPS = np.linspace(-12, 12, 4801)  # standard deviations


def optimizer_of(splats: Splats) -> SplatOptimizer:
    return SplatOptimizer(splats, LearningRates(extent=1.0, total_steps=1000))


def kernel_change(length: float, f_a: float = 0.0, F: float = 1.0) -> float:
    """The largest change of G - f_a G' by g along the normal, as it is written."""
    g = (1 + np.exp(-4)) / (1 + np.exp(np.clip(-4 - length * STEPS, None, 700)))
    return np.abs((np.exp(-(STEPS**2) / 2) - f_a * np.exp(-((STEPS / F) ** 2) / 2)) * (g - 1)).max()


@pytest.mark.parametrize("length", [0.0, 0.01, 0.3, 1.0, 4.0, 30.0, 1e4])
def test_the_largest_change_of_a_kernel_is_that_of_its_formula(length):
    assert largest_change(np.array([length]))[0] == pytest.approx(kernel_change(length), rel=5e-3)


def test_longer_normals_change_more():
    changes = largest_change(np.geomspace(1e-3, 1e6, 200))
    assert np.all(np.diff(changes) >= 0) and 0.9 < changes[-1] <= 1


def one(normal, opacity: float = 0.9, plane: Kind = CUT, **dog) -> Splats:
    """A primitive before the camera, larger than a pixel and cut off across the picture."""
    whole = make_splats([[0, 0, 3]], (0.4, 0.3, 0.2), opacity, 1.0, [[0.1, 0.2, 0.7, 0.6]], **dog)
    return rounded(plane.given(whole, normal))


def is_shown(splats: Splats, plane: Kind = CUT, rule: CutRule | None = None) -> bool:
    return shown_cuts(rule or CutRule(), optimizer_of(splats), plane.group)[0]


def change_of_picture(splats: Splats) -> float:
    """The largest change of α, which here does not end at 1/255: the primitive is white."""
    pictures = [image_of(rasterized(s, CAMERA, **SMOOTH_OPTIONS), CAMERA) for s in (splats, splats.without_cuts())]
    return float(np.abs(pictures[0] - pictures[1]).max())


@EACH_PLANE
@pytest.mark.parametrize("opacity", [0.9, 0.3])
@pytest.mark.parametrize("direction", [(1, 0, 0), (0, -1, 0), (0.6, 0.5, -0.6)])
def test_what_goes_changes_no_pixel_by_a_255th_and_what_is_twice_that_shows(opacity, direction, kind: Kind):
    normal = np.array(direction) / np.linalg.norm(direction)
    lengths = np.geomspace(0.01, 20, 60)
    shown = [is_shown(one(k * normal, opacity, kind), kind) for k in lengths]
    first = shown.index(True)
    assert 0 < first < 59 and all(shown[first:])
    assert change_of_picture(one(lengths[first - 1] * normal, opacity, kind)) < 1 / 255
    flat = np.argmax(np.abs(normal)) != 2  # along the view a cut is not seen at all
    assert change_of_picture(one(4 * lengths[first] * normal, opacity, kind)) > 1 / 255 or not flat


@pytest.mark.parametrize(("f_a", "F"), [(0.5, 0.6), (0.95, 1.6), (0.99, 4.0)])
def test_of_a_dog_primitive_the_wider_kernel_counts(f_a, F):
    for length in np.geomspace(0.02, 10, 40):
        splats = one([length, 0, 0], 0.98, dog=[0], f_a=f_a, F=F)
        if not is_shown(splats):
            assert 0.98 * kernel_change(length, f_a, F) < 1 / 255
            assert change_of_picture(splats) < 1 / 255
    wide = one([0.15, 0, 0], 0.98, dog=[0], f_a=0.99, F=4.0)
    assert is_shown(wide)
    assert not is_shown(replace(wide, dog_log_scales=[[-0.5] * 3]))
    assert not is_shown(wide.plain())


def test_beside_another_plane_a_change_may_be_a_little_larger():
    """Far out on the side that the other one keeps, where it makes the primitive 1 + e⁻⁴ times as opaque."""
    change = 0.9 * largest_change(np.array([1.0]))[0]
    rule = CutRule(least=1.01 * change)
    both = replace(one([1, 0, 0]), second_cut_index=[0], second_cut_normals=[[0, 9, 0]])
    assert not is_shown(one([1, 0, 0]), CUT, rule) and is_shown(both, CUT, rule)


@EACH_PLANE
def test_the_end_leaves_out_what_no_pixel_shows_and_keeps_the_moments_of_the_others(kind: Kind):
    splats = rounded(make_splats(np.random.default_rng(0).normal(size=(6, 3)), 0.3, 0.9))
    normals = np.outer([0.01, 3, 0.02, 5, 0, 9], [0.0, 0.6, 0.8])
    optimizer = optimizer_of(rounded(kind.given(splats, normals, np.arange(6))))
    t: Any = SimpleNamespace(optimizer=optimizer)
    control = RowControl(GIVEN[kind.word], CutRule())
    (event,) = control.end(t, None)
    assert event.record == {"kind": f"{kind.word}_left_out", "count": 3, "left": 3}
    assert event.text == f"{kind.word.replace('_', ' ')} left out: 3, kept: 3"
    assert kind.index(optimizer.to_splats()).tolist() == [1, 3, 5]
    np.testing.assert_array_equal(kind.values(optimizer.to_splats()), normals[[1, 3, 5]].astype(np.float32))
    assert control.end(t, None) == []
    optimizer.set_rows(kind.group, np.zeros(0, int), {kind.name: np.zeros((0, 3))})
    assert control.end(t, None) == []


def test_a_threshold_of_0_keeps_all_and_a_large_one_keeps_none():
    splats = one([5, 0, 0])
    assert is_shown(splats, rule=CutRule(least=0.0)) and not is_shown(splats, rule=CutRule(least=0.95))
