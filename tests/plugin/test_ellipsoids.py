"""``to_ellipsoids``: the shape it builds, as Mitsuba's ``volprim_rf_basic`` sees it, and where ``dogsplat`` agrees."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, Splats, reference, to_ellipsoids, write_model, write_ply
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba
from mi_dogsplat.scene.transform import transformed
from splat_scenes import axis_rotation, dog_dict, make_splats, random_splats, rounded, scalar_transform, select

from benchmarks.renderers.ellipsoids import alone, at_centres, pictures, scenes
from benchmarks.renderers.ray_model import DOGSPLAT, VOLPRIM, render_points

CAMERA = Camera(np.eye(4), 40.0, 40.0, 24.0, 18.0, 48, 36)
MODEL = rounded(random_splats(12, seed=1, degree=2))
SIMILARITY = affine(1.5 * axis_rotation([1, 2, 3], 0.9)[0], (1, -2, 3))
TENSORS = ("centers", "scales", "quaternions", "opacities", "sh_coeffs")


def thick(degree: int = 1, n: int = 12) -> Splats:
    """Without thin axes, on which the intersections of Mitsuba are inexact (docs/ellipsoids.md)."""
    rng = np.random.default_rng(3)
    splats = make_splats(rng.uniform([-1.5, -1.2, 2.5], [1.5, 1.2, 5], (n, 3)), rng.uniform(0.15, 0.5, (n, 3)),
                         rng.uniform(0.1, 0.98, n), rng.uniform(0.2, 0.8, (n, 3)), rng.normal(size=(n, 4)))
    rest = rng.normal(0, 0.3, (n, (degree + 1) ** 2 - 1, 3))
    splats.sh_coeffs = np.concatenate([splats.sh_coeffs, rest], axis=1)
    return rounded(splats)


def centres(camera: Camera) -> np.ndarray:
    return np.stack(reference.pixel_centres(0, 0, camera.width, camera.height), 1)


def traced(splats: Splats, camera: Camera = CAMERA) -> np.ndarray:
    """[H, W, 3] of ``volprim_rf_basic``, on the rays through the pixel centres."""
    scene = scenes(splats, camera)[1]
    return at_centres(scene.integrator(), scene, camera)


def assert_same(got: dict, expected: dict, **tolerance):
    assert set(got) == set(expected)
    for name in TENSORS:
        ours, theirs = got[name].numpy(), expected[name].numpy()
        if name == "quaternions":  # q and -q are one rotation; which one comes out is left to the last bit
            ours = np.where(np.sum(ours * theirs, axis=1, keepdims=True) < 0, -ours, ours)
        np.testing.assert_allclose(ours, theirs, err_msg=name, **tolerance)


class Listener(mi.Appender):
    def __init__(self):
        mi.Appender.__init__(self)
        self.warnings: list[str] = []

    def append(self, level: mi.LogLevel, text: str):
        if level == mi.LogLevel.Warn:
            self.warnings.append(text)


@contextmanager
def warnings() -> Iterator[list[str]]:
    """What Mitsuba's logger warns of inside; it reaches no other appender."""
    of_thread: Any = mi.logger
    logger = of_thread()
    others: list[Any] = [logger.appender(k) for k in range(logger.appender_count())]
    listener = Listener()
    logger.clear_appenders()
    logger.add_appender(listener)
    try:
        yield listener.warnings
    finally:
        logger.clear_appenders()
        for appender in others:
            logger.add_appender(appender)


@pytest.fixture
def quiet() -> Iterator[None]:
    with warnings():
        yield


# The shape

def test_the_shape_has_the_activated_parameters_in_the_conventions_of_mitsuba():
    splats = thick(degree=2)
    splats.quats[:] *= np.repeat([[1e-25], [1e12]], 6, 0)
    splats.quats[3] = 0
    made = to_ellipsoids(splats)
    assert made["type"] == "ellipsoids" and made["extent"] == 3.0
    np.testing.assert_array_equal(made["centers"].numpy(), splats.means)
    np.testing.assert_allclose(made["scales"].numpy(), np.exp(splats.log_scales), rtol=1e-6)
    np.testing.assert_allclose(made["opacities"].numpy(), 1 / (1 + np.exp(-splats.logit_opacities[:, None])), rtol=1e-6)
    np.testing.assert_array_equal(made["sh_coeffs"].numpy().reshape(-1, 9, 3), splats.sh_coeffs)
    quats = made["quaternions"].numpy()
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1, rtol=1e-6)
    np.testing.assert_array_equal(quats[3], [0, 0, 0, 1])
    np.testing.assert_allclose(reference.rotations(quats.astype(float)),
                               reference.rotations(splats.quats.astype(float)), atol=1e-6)


def test_it_is_what_mitsuba_itself_makes_of_the_file(tmp_path):
    splats = thick(degree=3)
    write_ply(tmp_path / "model.ply", splats)
    ours: Any = mi.traverse(mi.load_dict(to_ellipsoids(splats)))
    theirs: Any = mi.traverse(mi.load_dict({"type": "ellipsoids", "filename": str(tmp_path / "model.ply")}))
    for name in ("data", "opacities", "sh_coeffs", "extent"):
        np.testing.assert_allclose(np.array(ours[name]), np.array(theirs[name]), rtol=1e-5, atol=1e-6, err_msg=name)


def test_a_model_a_file_and_a_shape_give_the_same(tmp_path, quiet):
    write_ply(tmp_path / "model.ply", MODEL)
    shape: Any = mi.load_dict(dog_dict(MODEL))
    expected = to_ellipsoids(MODEL)
    for model in (Model(MODEL), tmp_path / "model.ply", str(tmp_path / "model.ply"), shape):
        assert_same(to_ellipsoids(model), expected)
    params: Any = mi.traverse(shape)
    params["means"] = params["means"] + 1
    params.update()
    np.testing.assert_allclose(to_ellipsoids(shape)["centers"].numpy(), MODEL.means + 1)


def test_a_variant_later_the_shape_is_still_known(quiet):
    if "llvm_ad_mono" not in mi.variants():
        pytest.skip("llvm_ad_mono is not built into this Mitsuba")
    mi.set_variant("llvm_ad_mono")
    assert to_ellipsoids(mi.load_dict(dog_dict(MODEL)))["centers"].shape == (12, 3)


# What is left out

def test_the_negative_part_of_a_dog_model_is_left_out_and_reported():
    assert 0 < MODEL.n_dog < MODEL.n_splats
    with warnings() as said:
        got = to_ellipsoids(MODEL)
    assert len(said) == 1 and f"the negative part of {MODEL.n_dog} DoG primitives" in said[0]
    with warnings() as said:
        assert_same(got, to_ellipsoids(MODEL.plain()))
    assert not said


def test_that_colours_are_linear_is_said_for_a_model_a_file_and_a_shape(tmp_path):
    linear = Model(thick(), Drawing(linear=True))
    write_model(tmp_path / "a.ply", linear)
    shape: Any = mi.load_dict({"type": "dog", "filename": str(tmp_path / "a.ply")})
    for model in (linear, tmp_path / "a.ply", shape):
        with warnings() as said:
            to_ellipsoids(model)
        assert len(said) == 1 and "linear radiance; set srgb_primitives to false" in said[0]


def test_what_cannot_be_seen_is_left_out_and_reported():
    splats = thick()
    splats.logit_opacities[0] = np.log(0.0035 / (1 - 0.0035))  # 1/255 is .0039
    splats.means[1, 2], splats.log_scales[2, 0], splats.sh_coeffs[3, 1, 1] = np.nan, np.inf, -np.inf
    splats.quats[4, 0], splats.logit_opacities[5] = np.nan, np.nan
    with warnings() as said:
        got = to_ellipsoids(splats)
    assert len(said) == 1 and "6 of 12 primitives that are fainter than 1/255 or not finite" in said[0]
    assert_same(got, to_ellipsoids(splats.select(np.arange(6, 12))))


def test_faint_primitives_are_seen_and_flat_ones_spoil_no_pixel():
    """Opacities below .01 are where Mitsuba's adaptive shells are NaN; a square of 1e-30 is no float."""
    camera = Camera(np.eye(4), 40.0, 40.0, 8.0, 8.0, 16, 16)
    faint = traced(rounded(make_splats([[0, 0, 4]], 1.0, 0.006)), camera)
    np.testing.assert_allclose(faint[8, 8], 0.006, rtol=0.02)
    flat = make_splats([[0, 0, 4], [0, 0, 5]], [[1, 1, 1e-30], [1, 1, 1]], 0.5, quats=[0.1, 0, 0, 1])
    image = traced(rounded(flat), camera)
    assert np.isfinite(image).all() and image[8, 8].min() > 0.45


# Mitsuba sees what it should

@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_the_picture_is_that_of_the_float64_model_at_every_sh_degree(degree):
    splats = thick(degree)
    expected = render_points(splats, CAMERA, centres(CAMERA), VOLPRIM).reshape(36, 48, 3)
    error = np.abs(traced(splats) - expected)
    assert error.mean() < 1e-5 and expected.max() > 0.5
    assert error.max() < 0.012  # of one that Mitsuba finds on the other side of its shell, where it has 1.1 %


def test_the_float64_model_of_the_rules_is_the_twin_of_dogsplat_at_the_other_end():
    splats = rounded(random_splats(30, seed=2, dog_share=0))
    got = render_points(splats, CAMERA, centres(CAMERA), DOGSPLAT).reshape(36, 48, 3)
    np.testing.assert_allclose(got, reference.render(splats, CAMERA)[0], atol=1e-12)


def test_to_world_moves_the_model_as_it_moves_the_shape_dog():
    splats = thick(degree=3)
    moved = to_ellipsoids(splats, to_world=scalar_transform(SIMILARITY))
    assert_same(to_ellipsoids(splats, to_world=SIMILARITY), moved, atol=1e-5)
    shape: Any = mi.load_dict(dog_dict(splats, to_world=scalar_transform(SIMILARITY)))
    assert_same(to_ellipsoids(shape), moved, atol=1e-5)

    rigid = affine(axis_rotation([1, 2, 3], 0.9)[0], (0.4, -0.2, 0.3))
    along = Camera(CAMERA.w2c @ np.linalg.inv(rigid), 40.0, 40.0, 24.0, 18.0, 48, 36)
    assert np.abs(traced(transformed(splats, rigid), along) - traced(splats)).mean() < 1e-5


# Where both renderers agree

@pytest.mark.parametrize("pixels", [2, 8, 32])
@pytest.mark.parametrize("distance, sigma", [(4.0, 0.25), (16.0, 0.5), (16.0, 1.0)])
def test_a_distant_gaussian_looks_the_same_up_to_the_low_pass_filter_and_the_perspective(distance, sigma, pixels):
    """The bound follows from the two formulas.

    With q = (f σ / z)² and a pixel at distance ρ from the middle, both are a exp(-c ρ² / 2q). EWA has c = q / (q + .3);
    the peak on a ray at the angle θ has c = cos² θ, and cos² θ >= 1 - 9 σ²/z² inside a shell of 3 σ. u exp(-u c) is at
    most 1 / (e c), so two values of c in m..1 are at most (1 - m) / (e m) apart. Outside of its shell, or below 1/255,
    one of the two has nothing.
    """
    splats, camera = alone(distance, sigma, pixels)
    ours, theirs, _ = pictures(splats, camera)
    opacity = float(splats.opacities[0])
    m = min(pixels**2 / (pixels**2 + 0.3), 1 - 9 * (sigma / distance) ** 2)
    bound = opacity * ((1 - m) / (np.e * m) + max(1 / 255, opacity * np.exp(-4.5)))
    color = np.maximum(splats.sh_coeffs[0, 0] * 0.28209479 + 0.5, 0)
    assert np.all(np.abs(ours - theirs) <= bound * color)
    assert ours.max() > 0.8 * opacity * color.max()

    tangent = np.linalg.norm(centres(camera) - camera.cx, axis=1).reshape(ours.shape[:2]) / camera.fx
    squared = (distance / sigma) ** 2 * tangent**2 / (1 + tangent**2)  # of the distance from the ray, in σ
    peak = np.where(squared < 9, opacity * np.exp(-0.5 * squared), 0)
    inside = np.abs(squared - 9) > 0.1
    np.testing.assert_allclose(theirs[inside], (peak[..., None] * color)[inside], atol=1e-4)


def test_a_mesh_hides_what_is_behind_it_and_neither_reflects_nor_shows_light():
    """What the page says of ``volprim_rf_basic``: should Mitsuba learn to shade, it has to be written anew."""
    splats = rounded(make_splats([[0, 0, 4]], 0.5, 0.9, [[0.9, 0.5, 0.2]]))
    near = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0.4, 0, 2]).rotate([0, 1, 0], 180)
            .scale([0.4, 0.4, 1]), "bsdf": {"type": "conductor"}}
    light = {"type": "point", "position": [0, 0, 0], "intensity": 10.0}
    scene: Any = mi.load_dict({"type": "scene", "model": to_ellipsoids(splats), "near": near, "light": light,
                               "sky": {"type": "constant"}, "sensor": camera_to_mitsuba(CAMERA),
                               "integrator": {"type": "volprim_rf_basic", "srgb_primitives": False}})
    image = at_centres(scene.integrator(), scene, CAMERA)
    alone_ = traced(splats)
    hidden = np.zeros(image.shape[:2], bool)
    hidden[11:25, 25:39] = True
    assert alone_[hidden].max() > 0.5
    np.testing.assert_array_equal(image[hidden], 0)
    np.testing.assert_allclose(image[:, :23], alone_[:, :23], atol=1e-6)


# Errors

def test_wrong_arguments_are_refused_with_a_line_that_says_why(tmp_path, quiet):
    (tmp_path / "bad.ply").write_text("ply\n")
    hidden = thick()
    hidden.logit_opacities[:] = -20
    cases: list[tuple[Any, dict[str, Any], str]] = [
        (MODEL, {"extent": 0.0}, "extent is 0.0, it must be positive"),
        (MODEL, {"extent": float("nan")}, "extent is nan"),
        (MODEL, {"to_world": np.diag([1, 0, 1, 1])}, "cannot be flattened"),
        (Splats.empty(1), {}, "no primitive that can be seen"),
        (hidden, {}, "no primitive that can be seen"),
        (tmp_path / "bad.ply", {}, "bad.ply"),
        (Path(tmp_path / "none.ply"), {}, "none.ply"),
        (mi.load_dict({"type": "sphere"}), {}, 'a shape "dog", this is'),
    ]
    for model, options, problem in cases:
        with pytest.raises(ValueError, match=problem):
            to_ellipsoids(model, **options)


def test_the_extent_of_the_shells_is_that_asked_for(quiet):
    splats = select(make_splats([[0, 0, 4]], 0.5, 0.9), 1)
    for extent in (1.0, 2.5):
        scene: Any = mi.load_dict({"type": "scene", "model": to_ellipsoids(splats, extent=extent)})
        t = scene.ray_intersect_preliminary(mi.Ray3f(mi.Point3f(0, 0, 0), mi.Vector3f(0, 0, 1))).t
        np.testing.assert_allclose(np.array(t).ravel()[0], 4 - extent * 0.5, rtol=1e-5)
