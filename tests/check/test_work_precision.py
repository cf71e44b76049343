"""Error against run time: the front, what must get better along a curve, and what an error of a gradient is."""

import numpy as np
import pytest
from mi_dogsplat.check import curves
from mi_dogsplat.check.curves import GROUPS, Point, Subset, points_of
from mi_dogsplat.check.rows import rows_of
from mi_dogsplat.check.scenes import Scene, model_scene, synthetic_scenes
from mi_dogsplat.check.work_precision import Job, adjoint, measure, on_all_rows, pareto_front
from mi_dogsplat.engine.geometry import SMOOTH, Cutoffs
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.reference.forward import RAW_PARAMETERS, raw_names
from mi_dogsplat.scene.row_groups import BESIDE_DOG
from splat_scenes import make_camera, make_splats, random_splats, rounded

KNOBS = {  # a few points of each curve: every setting is a kernel to compile
    "ALPHA": {"1/64": 1 / 64, "1/255": 1 / 255, "2^-20": 2**-20},
    "TRANSMITTANCE": {"1e-1": 1e-1, "1e-4": 1e-4, "0": 0.0},
    "BOUND": {"16": 16.0, "1": 1.0, "1/16": 1 / 16},
    "PATCH": {"1 x 1": 1, "4 x 4": 4},
    "KEPT": {"100 %": 1.0, "50 %": 0.5, "5 %": 0.05},
}


def faint_splats():
    """Nothing hides much: only the alpha cutoff makes an error."""
    splats = random_splats(60, seed=3, degree=1)
    splats.logit_opacities = np.random.default_rng(0).uniform(-4, -1.5, 60)
    return rounded(splats)


@pytest.fixture
def few_points(monkeypatch):
    for name, points in KNOBS.items():
        monkeypatch.setattr(curves, name, points)


@pytest.fixture
def faint() -> Scene:
    return Scene("faint", "", faint_splats(), make_camera(40, 32, 36.0))


def image(scene: Scene, **options) -> np.ndarray:
    subset = Subset.of(scene.splats, np.arange(scene.splats.n_splats))
    return Job(scene, Point("", "", RasterOptions(sh_degree=scene.splats.sh_degree, **options), subset)).image()


def test_the_front_is_what_brute_force_finds():
    rng = np.random.default_rng(0)
    for n in (0, 1, 2, 30):
        cost, error = rng.integers(0, 6, (2, n)).astype(float)  # integers: many ties
        expected = [
            not any((cost[j] <= cost[i] and error[j] < error[i]) or (cost[j] < cost[i] and error[j] <= error[i])
                    for j in range(n))
            for i in range(n)
        ]  # fmt: skip
        assert pareto_front(cost.tolist(), error.tolist()).tolist() == expected


def test_what_is_unknown_is_not_on_the_front_and_beats_nothing():
    front = pareto_front([1.0, 0.0, 2.0, 3.0], [1.0, None, float("nan"), 1.0])
    assert front.tolist() == [True, False, False, False]


def test_equal_points_share_the_front():
    assert pareto_front([1, 1, 2], [1, 1, 2]).tolist() == [True, True, False]


def test_the_adjoint_is_smooth_and_always_the_same():
    a = adjoint(64, 80)
    assert a.shape == (64, 80, 3) and np.array_equal(a, adjoint(64, 80))
    assert 0.5 < a.std() < 2 and np.abs(np.diff(a, axis=1)).max() < np.ptp(a) / 4
    assert not np.allclose(a[..., 0], a[..., 1])


def test_the_default_is_a_point_on_every_curve_and_every_knob_is_turned_alone(few_points, faint):
    points = points_of(faint)
    default, none = points[:2]
    assert (default.label, none.label, none.options.cutoffs) == ("default", "no cutoffs", SMOOTH)
    assert {p.group for p in points[2:]} == set(GROUPS[:-5])
    for group in GROUPS[:-5]:
        curve = [p for p in points if p.group == group]
        assert sum(p.key == default.key for p in curve) == 1, group
        assert len({p.key for p in curve}) == len(curve) > 1, group
    assert default.options.cutoffs == Cutoffs()
    assert all(p.subset is default.subset or p.options == default.options for p in points)


def test_the_primitives_kept_are_those_that_the_picture_would_miss_most(few_points):
    view = make_camera(40, 32, 36.0)
    splats = make_splats([(0, 0, 2 + i) for i in range(20)], scales=0.3, opacities=0.7)  # one behind the other
    kept = [p.subset.kept for p in points_of(Scene("", "", rounded(splats), view)) if p.group == "primitives kept"]
    assert [list(rows) for rows in kept] == [[0], list(range(10)), list(range(20))]


def test_knobs_that_a_model_does_not_have_make_no_curve(few_points):
    plain = make_splats(np.random.default_rng(0).uniform(-0.5, 0.5, (30, 3)) + (0, 0, 3))
    groups = {p.group for p in points_of(Scene("", "", rounded(plain), make_camera()))}
    assert groups == {"", *GROUPS} - {
        *("SH degree", "DoG", "slopes", "curvatures", "cuts", "second cuts", "shifts")
    }  # fmt: skip


@pytest.mark.slow
def test_tighter_settings_are_nearer_to_the_truth(few_points, faint):
    result = measure(faint, rounds=1)
    assert (result["n"], result["n_dog"]) == (60, faint.splats.n_dog)
    rows = {(row["group"], row["setting"]): row for row in result["rows"]}

    def errors(group: str, key: str) -> list[float]:
        return [row[key] for row in result["rows"] if row["group"] == group]

    for key in ("mean_error", "max_error", "worst_gradient_error"):
        coarse, default, fine = errors("alpha cutoff", key)
        assert coarse > 2 * default > 20 * fine, key
        assert errors("primitives kept", key) == sorted(errors("primitives kept", key), reverse=True)
        assert errors("bound", key)[0] > errors("bound", key)[1]
    exact = rows["", "no cutoffs"]
    assert exact["mean_error"] < 1e-6 and exact["worst_gradient_error"] < 1e-4 and exact["psnr"] > 110
    assert set(exact["gradient_error"]) == set(RAW_PARAMETERS)
    assert result["n_slopes"] == result["n_cuts"] == result["n_second_cuts"] == result["n_shifts"] == 0
    assert rows["DoG", "without DoG"]["gradient_error"]["dog_log_scales"] == 1
    assert rows["SH degree", "degree 0"]["gradient_error"]["sh_coeffs"] > 0.5


@pytest.mark.parametrize(
    ("share", "kind", "name", "said"),
    [
        ("slope_share", "slopes", "color_slopes", "with slopes"),
        ("cut_share", "cuts", "cut_normals", "with a cut"),
        ("curvature_share", "curvatures", "brightness_curvatures", "with curvatures"),
        ("second_cut_share", "second cuts", "second_cut_normals", "with a second"),
        ("shift_share", "shifts", "view_shifts", "with shifts"),
    ],
)
def test_a_model_with_slopes_or_cuts_has_a_curve_with_and_without_them(share, kind, name, said, monkeypatch):
    for knob in KNOBS:
        monkeypatch.setattr(curves, knob, {})
    monkeypatch.setattr(curves, "KEPT", {"100 %": 1.0, "50 %": 0.5})
    splats, number = rounded(random_splats(60, 3, 0, 0, **{share: 0.5})), f"n_{kind.replace(' ', '_')}"
    count = getattr(splats, number)
    scene = model_scene("sloped", splats, make_camera(40, 32, 36.0), 40)
    assert f", {count} {said}" in scene.what and 20 < count < 40
    result = measure(scene, rounds=1)
    assert result[number] == count
    rows = {(row["group"], row["setting"]): row for row in result["rows"]}
    exact, half = rows["", "no cutoffs"], rows["primitives kept", "50 %"]
    without, default = rows[kind, f"without {kind}"], rows[kind, f"with {kind}"]
    assert exact["gradient_error"][name] < 1e-4 and 0.01 < half["gradient_error"][name] < 1
    assert without["gradient_error"][name] == 1 and without["mean_error"] > 3 * default["mean_error"]
    assert default["default"] and without["rounding_error"] < 1e-6 and default["rounding_error"] < 1e-6


def test_against_the_twin_with_the_same_cutoffs_only_rounding_is_left(few_points, faint):
    for row in measure(faint, rounds=1)["rows"]:
        if row["setting"] == "16":
            assert row["rounding_error"] is None
        else:
            assert row["rounding_error"] < 1e-6, row


def test_the_default_is_measured_once_and_marked(few_points, faint):
    rows = [row for row in measure(faint, rounds=1)["rows"] if row["default"]]
    # no slopes, curvatures, cuts, second ones and shifts, and none but the default is in no group
    assert len(rows) == len(GROUPS) - 4
    assert all({**row, "group": "", "setting": ""} == {**rows[0], "group": "", "setting": ""} for row in rows)


def test_the_fronts_belong_to_their_own_times_and_errors(few_points, faint):
    rows = measure(faint, rounds=2)["rows"]
    for front, cost, error in (("image_front", "forward_ms", "mean_error"),
                               ("gradient_front", "total_ms", "worst_gradient_error")):  # fmt: skip
        expected = pareto_front([row[cost] for row in rows], [row[error] for row in rows])
        assert [row[front] for row in rows] == expected.tolist() and expected.any()


def test_a_bound_of_one_leaves_out_nothing_that_is_drawn():
    scene = synthetic_scenes(64)[2]
    exact = image(scene)
    assert np.array_equal(exact, image(scene, cutoffs=Cutoffs(bound=1 / 16)))
    assert not np.array_equal(exact, image(scene, cutoffs=Cutoffs(bound=16)))


def test_the_image_is_over_the_background_of_the_scene(faint):
    empty = Scene("", "", faint.splats.select([0]), faint.camera, background=0.25, near_clip=100.0)
    assert np.all(image(empty) == 0.25)


def test_primitives_that_are_left_out_have_the_gradient_zero():
    rng, splats = np.random.default_rng(1), rounded(random_splats(60, 3, 1, *[0.5] * 6))
    kept = np.sort(rng.permutation(60)[:25])
    subset = Subset.of(splats.select(kept), kept)
    gradients = {name: rng.normal(size=getattr(subset.splats, name).shape) for name in raw_names(splats)}
    whole = on_all_rows({name: values.ravel() for name, values in gradients.items()}, subset, splats)
    assert set(whole) == {*RAW_PARAMETERS, *(name for group in BESIDE_DOG for name in group.names)}
    for name, values in whole.items():
        left = np.isin(rows_of(splats, name), kept)
        assert 0 < left.sum() < len(left) and values.shape == getattr(splats, name).shape
        assert np.array_equal(values[left], gradients[name]) and not values[~left].any()


def test_the_scenes_made_here_are_the_same_clouds_at_every_size():
    for small, large in zip(synthetic_scenes(64), synthetic_scenes(128), strict=True):
        assert 2000 <= small.splats.n_splats <= 5000
        assert all(np.array_equal(getattr(small.splats, f), getattr(large.splats, f)) for f in RAW_PARAMETERS)
        pixels, depth = small.camera.project(small.splats.means)
        assert np.allclose(2 * pixels, large.camera.project(large.splats.means)[0]) and depth.min() > 2
        assert np.mean(np.all((pixels >= 0) & (pixels <= (64, 48)), axis=1)) > 0.7
    needles = synthetic_scenes(64)[2].splats
    assert needles.n_dog == needles.n_splats // 2 and 50 < np.max(needles.scales.max(1) / needles.scales.min(1)) < 101


def test_a_model_is_seen_at_most_as_large_as_asked(faint):
    scene = model_scene("m", faint.splats, make_camera(400, 100), 200, background=1.0, near_clip=0.01)
    assert (scene.camera.width, scene.camera.height, scene.background, scene.near_clip) == (200, 50, 1.0, 0.01)
    assert model_scene("m", faint.splats, make_camera(40, 100), 200).camera.height == 100
    assert f"{faint.splats.n_dog} of them DoG" in scene.what
