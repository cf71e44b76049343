"""Slopes, curvatures, cuts and shifts come without a change of the pictures, and learn; rules scale with the run."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np
import pytest
from cut_models import with_cuts, with_second_cuts
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, PLANES, SECOND_CUTS, SHIFTS, SLOPES, RowGroup
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.given_rows import GIVEN
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.quantisation.quantiser import Coding, Quantiser
from mi_dogsplat.training.strategy.cut_activation import CutRule, largest_change
from mi_dogsplat.training.strategy.dog_control import DogRule, activate
from mi_dogsplat.training.strategy.row_activation import RowActivation, RowRule, give_rows
from mi_dogsplat.training.strategy.shift_activation import ShiftRule
from mi_dogsplat.training.strategy.slope_activation import SlopeRule
from shifted_models import with_shifts
from sloped_models import with_curvatures, with_slopes
from splat_scenes import image_of, kernels, options, random_splats, rounded, tilted_camera

CAMERA = tilted_camera()
EACH_KIND = pytest.mark.parametrize(
    ("group", "with_rows", "rate"),
    [(SLOPES, with_slopes, 2.5e-3), (CURVATURES, with_curvatures, 2.5e-3), (CUTS, with_cuts, 0.0625),
     (SECOND_CUTS, with_second_cuts, 0.0625), (SHIFTS, with_shifts, 5e-3)],
    ids=["slopes", "curvatures", "cuts", "second_cuts", "shifts"],
)
Given = Callable[..., Splats]


def model(dog_share: float = 0.5) -> Splats:
    return rounded(random_splats(40, degree=1, dog_share=dog_share))


def optimizer_of(splats: Splats) -> SplatOptimizer:
    return SplatOptimizer(splats, LearningRates(extent=1.0, total_steps=1000))


def image(optimizer: SplatOptimizer) -> np.ndarray:
    return image_of(rasterize(optimizer.params, DeviceCamera.upload(CAMERA), options(model())), CAMERA)


def step(optimizer: SplatOptimizer) -> None:
    r, g, b = rasterize(optimizer.params, DeviceCamera.upload(CAMERA), options(model())).colors
    dr.backward(dr.square(r - 0.2) + dr.square(g - 0.4) + dr.square(b - 0.2))
    optimizer.step()


@EACH_KIND
def test_activation_leaves_the_picture_and_then_every_row_learns(group: RowGroup, with_rows: Given, rate: float):
    optimizer, name = optimizer_of(model()), group.names[0]
    before = image(optimizer)
    assert give_rows(optimizer, group) == len(optimizer.index_of(group)) == 40
    np.testing.assert_allclose(image(optimizer), before, rtol=0, atol=5e-7)
    step(optimizer)
    rows = getattr(optimizer.to_splats(), name)
    seen = np.unique(np.nonzero(rows)[0])
    assert len(seen) > 30 and np.abs(rows).max() == pytest.approx(rate, rel=1e-3)


@EACH_KIND
def test_rows_that_are_there_stay_with_their_moments(group: RowGroup, with_rows: Given, rate: float):
    optimizer, name = optimizer_of(with_rows(model(), every=3)), group.names[0]
    size = optimizer.row_size[name]
    step(optimizer)
    before, state = optimizer.to_splats(), optimizer.state()
    index = getattr(before, group.index)
    assert index.tolist() == list(range(0, 40, 3))
    give_rows(optimizer, group)
    after, m = optimizer.to_splats(), optimizer.state()[f"{name}.m"].reshape(40, size)
    np.testing.assert_array_equal(getattr(after, name)[index], getattr(before, name))
    np.testing.assert_array_equal(m[index], state[f"{name}.m"].reshape(-1, size))
    others = np.delete(np.arange(40), index)
    assert not getattr(after, name)[others].any() and not m[others].any()


def test_a_primitive_becomes_dog_and_gets_slopes_curvatures_and_cuts_in_any_order():
    models, some = [], with_curvatures(with_slopes(model(dog_share=0.2)), every=7)
    for order in (("dog", SLOPES, CURVATURES, CUTS, SECOND_CUTS), (SECOND_CUTS, CUTS, "dog", CURVATURES, SLOPES),
                  (CURVATURES, SLOPES, SECOND_CUTS, CUTS, "dog")):  # fmt: skip
        optimizer = optimizer_of(with_second_cuts(with_cuts(some, every=3), every=5))
        for part in order:
            if isinstance(part, str):
                activate(DogRule(opacity=0.05), optimizer)
            else:
                give_rows(optimizer, part)
        models.append(optimizer.to_splats())
    for other in models[1:]:
        for name in Splats.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(models[0], name), getattr(other, name), err_msg=name)


@EACH_KIND
def test_with_no_row_left_training_runs_the_kernels_of_one_that_never_had_any(
    group: RowGroup, with_rows: Given, rate: float
):
    plain, optimizer = optimizer_of(model()), optimizer_of(model())
    give_rows(optimizer, group)
    step(optimizer)
    optimizer.set_rows(group, np.zeros(0, int), {})
    assert set(optimizer.params) == set(plain.params)
    step(plain)
    assert kernels(lambda: step(optimizer)) == kernels(lambda: step(plain))


@pytest.mark.parametrize("kind", [SlopeRule, CutRule, ShiftRule])
@pytest.mark.parametrize(("changes", "words"), [({"start": -1}, "start"), ({"least": -0.1}, "least")])
def test_a_number_out_of_range_is_refused_by_name(kind: type[RowRule], changes, words):
    with pytest.raises(ValueError, match=f"{kind.__name__}: {words} is"):
        kind(**changes)


@pytest.mark.parametrize("kind", [SlopeRule, CutRule, ShiftRule])
def test_the_start_scales_with_the_run_and_moves_with_its_beginning(kind: type[RowRule]):
    assert kind(start=18_000).scaled(7 / 30) == kind(start=4200)
    assert kind().scaled(1e-6).start == 1
    assert kind(start=18_000).earlier(15_000) == kind(start=3000) and kind(start=5).earlier(9).start == 0


@EACH_KIND
def test_what_sees_a_model_as_such_a_file_refuses_rows(group: RowGroup, with_rows: Given, rate: float):
    optimizer, camera = optimizer_of(with_rows(model())), DeviceCamera.upload(CAMERA)
    words = "cuts" if group in PLANES else "shifts" if group is SHIFTS else "slopes"
    with pytest.raises(ValueError, match=rf"Quantiser: spz holds no {words}; begin with Splats.without_{words}\(\)"):
        Quantiser("spz").before_step(Coding(), optimizer, [camera], options(model()), 0, 10)


# --- second planes ---


def activated(optimizer: SplatOptimizer, seed: int = 0) -> np.ndarray:
    """[N, 3] second normals, as they begin."""
    t: Any = SimpleNamespace(optimizer=optimizer, rng=np.random.default_rng(seed))
    (event,) = RowActivation(GIVEN["second_cuts"], CutRule()).act(t)
    assert event.record == {"kind": "second_cuts_activated", "count": optimizer.n}
    return optimizer.to_splats().second_cut_normals


def test_second_planes_begin_at_random_by_the_seed_of_the_run_and_those_that_are_there_stay():
    first, again, other = (activated(optimizer_of(model()), seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).min() > 0 and len(np.unique(first)) == first.size
    before = with_second_cuts(model(), every=3)
    found = activated(optimizer_of(before))
    np.testing.assert_array_equal(found[::3], before.second_cut_normals)
    np.testing.assert_array_equal(np.delete(found, np.s_[::3], 0), np.delete(first, np.s_[::3], 0))


def test_hardly_any_pixel_shows_that_second_planes_have_come():
    optimizer = optimizer_of(model())
    before = image(optimizer)
    normals = activated(optimizer)
    change = np.abs(image(optimizer) - before).max()
    assert 0 < change < 1 / 255
    drawn = np.random.default_rng(5).normal(0, normals.std(), (100_000, 3))
    assert largest_change(np.linalg.norm(drawn, axis=1)).max() < 1 / 255  # of an opaque primitive


def planes_after(steps: int, begin: Callable[[SplatOptimizer], Any]) -> tuple[np.ndarray, np.ndarray]:
    """[N, 3] normals of both planes, which come at the same step."""
    optimizer = optimizer_of(model())
    give_rows(optimizer, CUTS)
    begin(optimizer)
    for _ in range(steps):
        step(optimizer)
    found = optimizer.to_splats()
    return found.cut_normals, found.second_cut_normals


def test_each_second_plane_learns_and_some_soon_go_their_own_way():
    """Two that begin alike learn the same."""
    first, second = planes_after(150, lambda optimizer: give_rows(optimizer, SECOND_CUTS))
    assert np.abs(first).max() > 1 and np.abs(first - second).max() < 1e-3
    first, second = planes_after(150, activated)
    begun = activated(optimizer_of(model()))
    learned, apart = (np.linalg.norm(v, axis=1) for v in (second - begun, first - second))
    assert (learned > 0.5).sum() > 35 and np.linalg.norm(begun, axis=1).max() < 0.15
    assert (apart > 1).sum() >= 8
