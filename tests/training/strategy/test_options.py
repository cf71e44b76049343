"""What bytes are divided among: primitives, bands, DoG rows, slopes, curvatures, cuts go where they gain least."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat.formats.sizes import Prices
from mi_dogsplat.scene.curvatures import mean_brightness
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, DOG, PLANES, SECOND_CUTS, SHIFTS, SLOPES, RowGroup
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scores.bands import Bands
from mi_dogsplat.training.strategy.compaction import as_chosen
from mi_dogsplat.training.strategy.options import Chosen, Options, Rows
from shifted_models import with_shifts
from splat_scenes import C0, random_splats, rounded

PRICES = Prices(
    10.0,
    (100.0, 150.0, 200.0, 300.0),
    {DOG: 20.0, SLOPES: 40.0, CURVATURES: 28.0, CUTS: 30.0, SECOND_CUTS: 30.0, SHIFTS: 52.0},
)


def options_of(removal, by_degree, without_dog, splats: Splats, without=None) -> Options:
    """``without``: of other groups what is lost without them, for each primitive."""
    whole = splats.uniform_sh()
    nothing = [np.zeros(splats.n_splats)] * (whole.sh_coeffs.shape[1] * (whole.sh_coeffs.shape[1] + 1) // 2)
    losses = {DOG: np.array(without_dog)} | {group: np.array(lost) for group, lost in (without or {}).items()}
    rows = {group: Rows.of(getattr(splats, group.index), splats.n_splats, lost) for group, lost in losses.items()}
    shifted = np.isin(np.arange(splats.n_splats), splats.shift_index)
    bands = Bands(whole.sh_coeffs, nothing)
    return Options(np.array(removal), np.array(by_degree), splats.sh_degrees, rows, shifted, bands)


def four() -> Splats:
    """Of degrees 1, 1, 1, 0; the first two are DoG."""
    splats = rounded(random_splats(4, seed=0, degree=1, dog_share=0))
    dog = {"dog_index": [0, 1], "dog_logit_opacities": [0.0, 1.0], "dog_log_scales": np.zeros((2, 3))}
    arrays = {name: getattr(splats, name) for name in ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")}
    return Splats(**arrays, **dog).with_sh_degrees([1, 1, 1, 0])


LOSSES = ([9, 5, 4, 1.0], [[4, 0], [0.1, 0], [0.1, 0], [0, 0.0]], [3, 0.01, 0, 0.0])


@pytest.mark.parametrize(
    ("budget", "kept", "degrees", "dog"),
    [
        (1000, [0, 1, 2, 3], [1, 1, 1, 0], [0, 1]),  # all of it
        (485, [0, 1, 2, 3], [1, 0, 0, 0], [0]),  # bands and rows that hardly matter go first
        (385, [0, 1, 2], [1, 0, 0], [0]),  # then the last primitive
        (285, [0, 1], [1, 0], [0]),
        (60, [], [], []),
    ],
)
def test_bytes_go_where_they_gain_most(budget, kept, degrees, dog):
    chosen = options_of(*LOSSES, four()).chosen(PRICES, budget)
    np.testing.assert_array_equal(chosen.kept, kept)
    np.testing.assert_array_equal(chosen.degrees, degrees)
    np.testing.assert_array_equal(chosen.rows[DOG], dog)


def four_sloped() -> Splats:
    """The same, all but the second with slopes."""
    rng = np.random.default_rng(0)
    return replace(four(), slope_index=[0, 2, 3], color_slopes=rng.normal(size=(3, 3, 3)))


@pytest.mark.parametrize(
    ("budget", "kept", "degrees", "dog", "slopes"),
    [
        (1000, [0, 1, 2, 3], [1, 1, 1, 0], [0, 1], [0, 2, 3]),  # all of it
        (665, [0, 1, 2, 3], [1, 1, 1, 0], [0], [0, 2]),  # what hardly matters goes first
        (565, [0, 1, 2, 3], [1, 0, 0, 0], [0], [0, 2]),
        (525, [0, 1, 2, 3], [1, 0, 0, 0], [0], [0]),
        (425, [0, 1, 2], [1, 0, 0], [0], [0]),  # then the last primitive, before slopes that matter
    ],
)
def test_slopes_go_where_they_gain_least_for_their_bytes(budget, kept, degrees, dog, slopes):
    options = options_of([9, 5, 4, 3.0], *LOSSES[1:], four_sloped(), {SLOPES: [2.0, 0, 0.5, 0.02]})
    chosen = options.chosen(PRICES, budget)
    np.testing.assert_array_equal(chosen.kept, kept)
    np.testing.assert_array_equal(chosen.degrees, degrees)
    np.testing.assert_array_equal(chosen.rows[DOG], dog)
    np.testing.assert_array_equal(chosen.rows[SLOPES], slopes)
    model = as_chosen(four_sloped(), options, chosen)
    np.testing.assert_array_equal(model.slope_index, slopes)
    expected = four_sloped().color_slopes[np.searchsorted([0, 2, 3], slopes)]
    np.testing.assert_array_equal(model.color_slopes, expected)


def four_curved(sloped: bool) -> Splats:
    """Four, all but the first with curvatures."""
    curvatures = np.random.default_rng(2).normal(size=(3, 6))
    splats = four_sloped() if sloped else four()
    return replace(splats, curvature_index=[1, 2, 3], brightness_curvatures=curvatures)


@pytest.mark.parametrize("sloped", [False, True])
@pytest.mark.parametrize(
    ("budget", "kept", "curvatures"),
    [
        (1e9, [0, 1, 2, 3], [1, 2, 3]),  # all of it
        (640, [0, 1, 2, 3], [1, 2]),  # what hardly matters goes first
        (510, [0, 1, 2, 3], [1]),
        (410, [0, 1, 2], [1]),  # then the last primitive, before curvatures that matter
    ],
)
def test_curvatures_go_where_they_gain_least_for_their_bytes_and_leave_their_mean(sloped, budget, kept, curvatures):
    splats = four_curved(sloped)
    slopes = {SLOPES: [2.0, 0, 1.8, 1.7]} if sloped else {}  # more for their bytes than any curvature
    options = options_of([9, 6, 5, 3.0], *LOSSES[1:], splats, slopes | {CURVATURES: [0, 1.5, 0.2, 0.05]})
    chosen = options.chosen(PRICES, budget + 40 * (len(kept) - 1) * sloped)
    np.testing.assert_array_equal(chosen.kept, kept)
    np.testing.assert_array_equal(chosen.rows[CURVATURES], curvatures)
    model, rows = as_chosen(splats, options, chosen), np.array(curvatures) - 1
    np.testing.assert_array_equal(model.slope_index, np.intersect1d(splats.slope_index, kept))
    np.testing.assert_array_equal(model.curvature_index, curvatures)
    np.testing.assert_array_equal(model.brightness_curvatures, splats.brightness_curvatures[rows])
    average = np.zeros(4)  # of what went
    average[1:] = mean_brightness(splats.brightness_curvatures, splats.log_scales[1:])
    average[curvatures] = 0
    brighter = C0 * (model.uniform_sh().sh_coeffs[:, 0] - splats.uniform_sh().sh_coeffs[kept, 0])
    np.testing.assert_allclose(brighter, np.repeat(average[kept, None], 3, axis=1), atol=1e-6)
    assert len(curvatures) == 3 or np.abs(average[kept]).max() > 0.05


def four_cut(sloped: bool, *planes: RowGroup) -> Splats:
    """Four, all but the third cut off."""
    splats = four_sloped() if sloped else four()
    for plane in planes:
        normals = {name: np.random.default_rng(1).normal(size=(3, 3)) for name in plane.names}
        splats = replace(splats, **{plane.index: np.array([0, 1, 3])}, **normals)
    return splats


@pytest.mark.parametrize("plane", PLANES, ids=lambda plane: plane.index)
@pytest.mark.parametrize("sloped", [False, True])
@pytest.mark.parametrize(
    ("budget", "kept", "cuts"),
    [
        (1e9, [0, 1, 2, 3], [0, 1, 3]),  # all of it
        (655, [0, 1, 2, 3], [0, 1]),  # what hardly matters goes first
        (515, [0, 1, 2, 3], [0]),
        (410, [0, 1, 2], [0]),  # then the last primitive, before a cut that matters
    ],
)
def test_cuts_go_where_they_gain_least_for_their_bytes(plane, sloped, budget, kept, cuts):
    splats, (name,) = four_cut(sloped, plane), plane.names
    slopes = {SLOPES: [2.0, 0, 1.8, 1.7]} if sloped else {}  # more for their bytes than any cut
    options = options_of([9, 6, 5, 3.0], *LOSSES[1:], splats, slopes | {plane: [1.5, 0.2, 0, 0.05]})
    chosen = options.chosen(PRICES, budget + 40 * (len(kept) - 1) * sloped)
    np.testing.assert_array_equal(chosen.kept, kept)
    np.testing.assert_array_equal(chosen.rows[plane], cuts)
    model = as_chosen(splats, options, chosen)
    np.testing.assert_array_equal(model.slope_index, np.intersect1d(splats.slope_index, kept))
    np.testing.assert_array_equal(getattr(model, plane.index), cuts)
    np.testing.assert_array_equal(getattr(model, name), getattr(splats, name)[np.searchsorted([0, 1, 3], cuts)])


def test_of_two_cuts_the_one_goes_that_gains_less():
    splats = four_cut(False, *PLANES)
    options = options_of(*LOSSES, splats, {CUTS: [1.5, 0.03, 0, 0.9], SECOND_CUTS: [0.02, 1.2, 0, 0.9]})
    chosen = options.chosen(PRICES, 10 + 3 * 150 + 100 + 20 + 4 * 30)  # all but a DoG row and two cuts
    assert chosen.kept.tolist() == [0, 1, 2, 3] and chosen.degrees.tolist() == [1, 1, 1, 0]
    assert [places.tolist() for places in chosen.rows.values()] == [[0], [0, 3], [1, 3]]
    model = as_chosen(splats, options, chosen)
    assert (model.cut_index.tolist(), model.second_cut_index.tolist()) == ([0, 3], [1, 3])


@pytest.mark.parametrize(
    ("budget", "kept", "degrees", "dog"),
    [
        (1000, [0, 1, 2, 3], [1, 1, 1, 0], [0, 1]),  # all of it
        (480 + 2 * 52, [0, 1, 2, 3], [1, 0, 0, 0], [0]),  # bands and rows that hardly matter go first
        (480 + 2 * 52 - 1, [0, 1, 3], [1, 0, 0], [0]),  # then the primitive that its shifts have made dear
        (385, [0, 1], [1, 0], [0]),
    ],
)
def test_shifts_stay_with_their_primitives_and_raise_the_price_of_these(budget, kept, degrees, dog):
    """Without them the last primitive would go first."""
    splats = with_shifts(four())  # the first and the third
    options = options_of([9, 5, 1.2, 1.0], *LOSSES[1:], splats)
    chosen = options.chosen(PRICES, budget)
    np.testing.assert_array_equal(chosen.kept, kept)
    np.testing.assert_array_equal(chosen.degrees, degrees)
    np.testing.assert_array_equal(chosen.rows[DOG], dog)
    model = as_chosen(splats, options, chosen)
    expected = splats.select(kept)
    assert model.n_shifts == expected.n_shifts > 0
    for name in ("shift_index", "view_shifts", "mean_views"):
        np.testing.assert_array_equal(getattr(model, name), getattr(expected, name))


def test_slopes_that_are_to_come_cost_what_they_will_and_are_not_given_up():
    losses = [np.inf, 0, np.inf, np.inf]
    chosen = options_of(*LOSSES, four_sloped(), {SLOPES: losses}).chosen(PRICES, 10 + 3 * 140 + 100)
    assert chosen.kept.tolist() == [0, 1, 2] and chosen.rows[SLOPES].tolist() == [0, 2]


def test_a_degree_does_not_rise():
    options = options_of([9, 9, 9, 9.0], np.array([[1, -5.0]] * 4), np.zeros(4), four())
    assert options.chosen(PRICES, 1e9).degrees.tolist() == [1, 1, 1, 0]


def test_at_the_end_whole_primitives_go_and_the_outermost_stay():
    splats = four()
    splats.means[:] = [[0, 0, 0.5], [1, 1, 1], [-1, 0, 2], [0.5, -3, 0]]  # the first is in the middle
    options = options_of(*LOSSES, splats).of_whole_primitives(splats.means)
    everything = options.chosen(PRICES, 1e9)
    assert everything.degrees.tolist() == [1, 1, 1, 0] and everything.rows[DOG].tolist() == [0, 1]
    fewer = options.chosen(PRICES, 10 + 100 + 150 + 170)
    assert fewer.kept.tolist() == [1, 2, 3] and fewer.degrees.tolist() == [1, 1, 0] and fewer.rows[DOG].tolist() == [0]


def test_the_model_of_a_choice_has_what_was_chosen():
    splats, options = four(), options_of(*LOSSES, four())
    result = as_chosen(splats, options, options.chosen(PRICES, 385))
    np.testing.assert_array_equal(result.means, splats.means[:3])
    assert result.sh_degrees.tolist() == [1, 0, 0] and result.dog_index.tolist() == [0]
    assert result.dog_logit_opacities.tolist() == [0.0]
    np.testing.assert_array_equal(result.uniform_sh().sh_coeffs[0], splats.uniform_sh().sh_coeffs[0])


def test_what_may_not_go_is_no_option_and_takes_no_memory():
    """At the first checks all rows are still to come, and primitives are many: 2^k options each would be gigabytes."""
    n, rng = 4000, np.random.default_rng(0)
    groups = (SLOPES, CURVATURES, CUTS, SECOND_CUTS)
    removal, by_degree = rng.random(n) * 10, np.sort(rng.random((n, 4)), axis=1)[:, ::-1]
    has = {group: rng.random(n) < 0.5 for group in groups}

    def chosen(lost: float) -> tuple[Chosen, int]:
        rows = {group: Rows(has[group], np.where(has[group], lost, 0.0)) for group in groups}
        nothing = Bands(np.zeros((n, 16, 3)), [])
        options = Options(removal, by_degree, np.full(n, 3), rows, np.zeros(n, bool), nothing)
        tracemalloc.start()
        try:
            return options.chosen(PRICES, 200.0 * n), tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    (held, peak), (dear, _) = chosen(np.inf), chosen(1e9)
    assert 0 < len(held.kept) < n and peak < 1000 * n
    for group in groups:
        np.testing.assert_array_equal(held.rows[group], np.flatnonzero(has[group][held.kept]))
        np.testing.assert_array_equal(held.rows[group], dear.rows[group])
    np.testing.assert_array_equal(held.kept, dear.kept)
    np.testing.assert_array_equal(held.degrees, dear.degrees)
