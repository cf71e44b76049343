"""Stiff and extreme inputs: each gives the right number or a documented one, and never a NaN."""

from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat.check import stability
from mi_dogsplat.check.case_models import SHIFTS_OF_ONE, bystanders, camera, primitives
from mi_dogsplat.check.cases import Case, cases
from mi_dogsplat.check.rows import rows_of
from mi_dogsplat.check.stability import GRADIENT_TOLERANCE, IMAGE_TOLERANCE, answer, measure
from mi_dogsplat.engine.geometry import SMOOTH, Cutoffs

CASES = {f"{case.group}: {case.name}": case for case in cases(layers=1000)}  # the check has ten times as many


@pytest.mark.parametrize("name", CASES)
def test_the_answer_is_right_or_documented(name):
    row = measure(CASES[name])
    assert row["finite"]
    assert row["verdict"] != "wrong", row


@pytest.mark.parametrize("name", [name for name in CASES if name.startswith("not finite")])
def test_the_primitive_that_is_not_finite_has_no_gradient_and_leaves_its_neighbours_alone(name):
    case = CASES[name]
    broken, whole = case.extreme[0], np.setdiff1d(np.arange(case.splats.n_splats), case.extreme[:1])
    without = Case(case.group, name, case.splats.select(whole), case.camera, case.extreme[:0])
    for cutoffs in (Cutoffs(), SMOOTH):
        got, expected = answer(case, cutoffs), answer(without, cutoffs)
        np.testing.assert_array_equal(got.image, expected.image)
        for parameter, gradient in got.gradients.items():
            of_broken = rows_of(case.splats, parameter) == broken
            assert not gradient[of_broken].any()
            others = expected.gradients[parameter]
            np.testing.assert_allclose(gradient[~of_broken], others, rtol=1e-5, atol=1e-6, err_msg=parameter)


@pytest.mark.parametrize("name", ["stored there", "seen there"])
def test_what_is_too_far_for_derivatives_by_its_depth_is_not_drawn_and_has_no_gradient(name):
    at = {"stored there": {"means": (0.1, 0.2, 3e38)}, "seen there": {"means": (0.1, 0.2, 4), "log_scales": 87}}
    far = primitives(**at[name], shifts=SHIFTS_OF_ONE)
    splats = bystanders(None, None, None, None, SHIFTS_OF_ONE).joined(far)
    got = answer(Case("shifts", name, splats, camera(), np.arange(12, 13)), Cutoffs())
    assert np.isfinite(got.image).all()
    for parameter, gradient in got.gradients.items():
        of_far = rows_of(splats, parameter) == 12
        assert np.isfinite(gradient).all() and not gradient[of_far].any(), parameter


def test_all_that_must_be_covered_is():
    groups = {case.group for case in CASES.values()}
    assert groups == {"shape", "size", "opacity", "colour", "depth", "quaternion", "DoG", "slopes",
                      "curvatures", "cuts", "shifts", "not finite", "camera"}  # fmt: skip
    assert len(CASES) == len(list(cases(layers=1000)))  # no two of one name
    assert sum(len(case.extreme) == 10_000 for case in cases()) == 5


def test_a_wrong_answer_is_called_wrong(monkeypatch):
    case = Case("shape", "x", primitives([(0.1, 0.2, 3), (0.3, 0.1, 4)]), camera(), np.arange(2))
    assert measure(case)["verdict"] == "right"
    assert verdict_of_changed(case, (20, 24), 1.1 * IMAGE_TOLERANCE, monkeypatch) == "wrong"
    monkeypatch.setattr(stability, "GRADIENT_TOLERANCE", 1e-12)
    assert measure(case)["verdict"] == "wrong"
    assert 0 < IMAGE_TOLERANCE < 1 / 255 and 0 < GRADIENT_TOLERANCE < 0.1


OTHERS = {
    "slopes, forgotten": lambda splats: splats.without_slopes(),
    "slopes, turned": lambda splats: replace(splats, color_slopes=splats.color_slopes.swapaxes(1, 2)),
    "cuts, forgotten": lambda splats: splats.without_cuts(),
    "cuts, turned": lambda splats: replace(splats, cut_normals=np.roll(splats.cut_normals, 1, axis=1)),
    "curvatures, forgotten": lambda splats: splats.without_curvatures(),
    "curvatures, turned": lambda splats: replace(
        splats, brightness_curvatures=splats.brightness_curvatures[:, ::-1]
    ),
    "second cuts, forgotten": lambda splats: splats.without_second_cuts(),
    "second cuts, turned": lambda splats: replace(splats, second_cut_normals=splats.second_cut_normals[:, ::-1]),
    "shifts, forgotten": lambda splats: splats.without_shifts(),
    "shifts, turned": lambda splats: replace(splats, view_shifts=splats.view_shifts.swapaxes(1, 2)),
    "shifts, from another mean view": lambda splats: replace(splats, mean_views=0 * splats.mean_views),
}


ORDINARY = {
    "slopes": "slopes: ordinary", "curvatures": "curvatures: ordinary", "cuts": "cuts: ordinary",
    "second cuts": "cuts: 300 that two planes cut off", "shifts": "shifts: ordinary",
}  # fmt: skip


@pytest.mark.parametrize("other", OTHERS)
def test_slopes_and_cuts_that_the_engine_forgets_or_turns_are_an_error(other, monkeypatch):
    case = CASES[ORDINARY[other.split(",")[0]]]
    image = answer(replace(case, splats=OTHERS[other](case.splats)), Cutoffs()).image
    monkeypatch.setattr(stability, "answer", lambda *given: replace(answer(*given), image=image))
    assert measure(case)["verdict"] == "wrong"


@pytest.mark.parametrize(
    ("group", "parameter"),
    [
        ("slopes", "color_slopes"),
        ("curvatures", "brightness_curvatures"),
        ("cuts", "cut_normals"),
        ("second cuts", "second_cut_normals"),
        ("shifts", "view_shifts"),
        ("shifts", "mean_views"),
    ],
)
def test_a_gradient_that_is_a_percent_off_is_an_error(group, parameter, monkeypatch):
    case = CASES[ORDINARY[group]]

    def changed(*given):
        right = answer(*given)
        right.gradients[parameter] *= 1 + 1.1 * GRADIENT_TOLERANCE
        return right

    monkeypatch.setattr(stability, "answer", changed)
    row = measure(case)
    assert row["verdict"] == "wrong" and row["worst_gradient"] == parameter


def test_a_pixel_is_judged_by_what_it_blends_and_not_by_the_brightest(monkeypatch):
    """Between the lobes T grows to 2^30, in a corner of the picture to 500."""
    case = CASES["DoG: 500 negative lobes on each other"]
    assert verdict_of_changed(case, (0, 0), 1.0, monkeypatch) == "wrong"


def test_a_lobe_that_is_missing_among_500_is_an_error(monkeypatch):
    case = CASES["DoG: 500 negative lobes on each other"]
    fewer = replace(case, splats=case.splats.select(np.delete(np.arange(case.splats.n_splats), case.extreme[250])))
    image = answer(fewer, Cutoffs()).image
    monkeypatch.setattr(stability, "answer", lambda *given: replace(answer(*given), image=image))
    assert measure(case)["verdict"] == "wrong"


def verdict_of_changed(case: Case, pixel: tuple[int, int], change: float, monkeypatch) -> str:
    """The verdict if the engine's image were another one at a pixel."""

    def changed(*given):
        right = answer(*given)
        right.image[pixel] += change
        return right

    with monkeypatch.context() as patch:
        patch.setattr(stability, "answer", changed)
        return measure(case)["verdict"]


def test_gradients_at_the_default_cutoffs_count_too(monkeypatch):
    """An engine with a cutoff of its own is right without cutoffs, and wrong with them."""
    case = Case("shape", "x", primitives([(0.1, 0.2, 3), (0.3, 0.1, 4)], opacity=0.02), camera(), np.arange(2))

    def other(case: Case, cutoffs: Cutoffs, weights: np.ndarray):
        default = answer(case, cutoffs, weights)
        own = answer(case, Cutoffs(alpha=1 / 200), weights)
        return default if cutoffs == SMOOTH else replace(default, gradients=own.gradients)

    monkeypatch.setattr(stability, "answer", other)
    row = measure(case)
    assert row["image_error"] < IMAGE_TOLERANCE and row["gradient_error"] < 1e-4
    assert row["default_gradient_error"] > GRADIENT_TOLERANCE and row["verdict"] == "wrong"


def test_a_pixel_on_the_edge_of_a_cutoff_has_no_weight_and_the_others_have():
    """The middle of the kernel is half a millionth above 1/255, or below, whichever way it is rounded."""
    for sign in (1, -1):
        splats = primitives((0, 0, 3), (0.2, 0.2, 0.2), opacity=(1 + sign * 5e-7) / 255)
        view = replace(camera(), cx=24.5, cy=20.5)
        case = Case("opacity", "on the edge", bystanders().joined(splats), view, np.array([12]))
        row = measure(case)
        assert row["undecided"] == 1 / (view.width * view.height) and row["verdict"] == "right"
