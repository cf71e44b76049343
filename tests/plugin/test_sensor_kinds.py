"""Every kind of sensor: where the engine projects a point is where Mitsuba's own rays through that pixel go."""

import itertools
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.plugin.samples import Sample, samples
from mi_dogsplat.plugin.sensor import SensorReader, View
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.mitsuba_cameras import OPENCV_FROM_MITSUBA
from splat_scenes import axis_rotation, dog_dict, random_splats, rounded, scene_of, select, sensor_dict, square_camera

MODEL = rounded(random_splats(60, seed=1))
ROTATION = axis_rotation([0.3, 1, -0.4], 0.9)[0]
CROP = {"crop_offset_x": 7, "crop_offset_y": 5, "crop_width": 20, "crop_height": 11}
SAMPLE = Sample(0.3, 0.85, 0.9, 0.2)


def film(width=64, height=48, **others) -> dict[str, Any]:
    return {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "rfilter": {"type": "box"},
            "component_format": "float32", **others}


def to_world(scale=(1.0, 1.0, 1.0)) -> mi.ScalarTransform4f:
    matrix: Any = affine(ROTATION * scale, (0.7, -0.2, 3))
    return mi.ScalarTransform4f(matrix)


def view_of(sensor: dict[str, Any]) -> View:
    return SensorReader().views(mi.load_dict(sensor), 0.0)[0]  # type: ignore[arg-type]


def number(value: Any) -> float:
    return float(np.array(value).ravel()[0])


def assert_rays_meet_their_pixels(view: View, sample: Sample, border: int = 0):
    """Points along the rays through the samples are projected to the centres of the camera's pixels."""
    view_pass = view.through(sample, border)
    camera, ray = view_pass.camera, view_pass.rays()
    W = np.array([[number(v) for v in row] for row in camera.rotation])
    fx, fy, cx, cy = map(number, (camera.fx, camera.fy, camera.cx, camera.cy))
    o, d = np.array(ray.o, float), np.array(ray.d, float)  # [3, P]
    o = o if o.shape[1] > 1 else np.repeat(o, d.shape[1], 1)
    d = d if d.shape[1] > 1 else np.repeat(d, o.shape[1], 1)
    c = np.array([number(a) + number(b) for a, b in zip(camera.position, camera.position_rest, strict=True)])
    y, x = np.mgrid[0:camera.height, 0:camera.width] + 0.5
    for distance in (1.0, 2.5, 30.0):
        local = W @ (o + d * distance - c[:, None])
        z = local[2] if camera.perspective else 1
        error = np.stack([fx * local[0] / z + cx - x.ravel(), fy * local[1] / z + cy - y.ravel()])
        rounding = 3e-7 * (5 + distance) * fx / (distance if camera.perspective else 1)  # of the rays, in float32
        assert np.abs(error).max() < max(1e-5, rounding), (distance, np.abs(error).max())


FOVS = [{"fov": 40.0, "fov_axis": axis} for axis in ("x", "y", "diagonal", "smaller", "larger")]
FOVS += [{"focal_length": "35mm"}]


@pytest.mark.parametrize("fov", FOVS, ids=str)
def test_a_perspective_sensor_sees_along_mitsubas_rays(fov):
    offsets = [{}, {"principal_point_offset_x": 0.13, "principal_point_offset_y": -0.4}]
    for offset, crop, size in itertools.product(offsets, ({}, CROP), ((64, 48), (48, 64))):
        sensor = {"type": "perspective", "to_world": to_world(), **fov, **offset, "film": film(*size, **crop)}
        for sample in (Sample(), SAMPLE):
            assert_rays_meet_their_pixels(view_of(sensor), sample)


@pytest.mark.parametrize("crop", [{}, CROP], ids=["whole", "crop"])
def test_a_thin_lens_sees_along_mitsubas_rays_through_each_point_of_the_lens(crop):
    sensor = {"type": "thinlens", "to_world": to_world(), "fov": 50.0, "aperture_radius": 0.2, "focus_distance": 2.5,
              "film": film(**crop)}
    for sample in (Sample(), SAMPLE, *samples(5, seed=2)):
        assert_rays_meet_their_pixels(view_of(sensor), sample)


@pytest.mark.parametrize("crop", [{}, CROP], ids=["whole", "crop"])
@pytest.mark.parametrize("kind", ["perspective", "thinlens"])
def test_primitives_are_linearised_up_to_the_same_margin_around_the_film_by_every_sample(kind, crop):
    """That is 15 % of the film, as each point of a lens sees it."""
    lens = {"aperture_radius": 0.7, "focus_distance": 2.5} if kind == "thinlens" else {}
    view = view_of({"type": kind, "to_world": to_world(), "fov": 50.0, "film": film(**crop), **lens})
    for sample, border in itertools.product((Sample(), SAMPLE, *samples(5, seed=2)), (0, 3)):
        camera = view.through(sample, border).camera
        fx, fy, cx, cy = map(number, (camera.fx, camera.fy, camera.cx, camera.cy))
        left = 0.5 - sample.x + border - crop.get("crop_offset_x", 0)  # of the film, in pixels of this camera
        top = 0.5 - sample.y + border - crop.get("crop_offset_y", 0)
        margin_x, margin_y = 0.15 * 64, 0.15 * 48
        expected = [cx - left + margin_x, left + 64 - cx + margin_x, cy - top + margin_y, top + 48 - cy + margin_y]
        limits = np.array([number(limit) for limit in camera.limits]) * (fx, fx, fy, fy)
        np.testing.assert_allclose(limits, expected, rtol=1e-5)  # rounding of float32 is below 1e-6


@pytest.mark.parametrize("scale", [(1, 1, 1), (2.5, 2.5, 1), (2, 3, 0.5), (-1.5, 1.5, 1)], ids=str)
def test_an_orthographic_sensor_sees_along_mitsubas_rays(scale):
    for crop in ({}, CROP):
        sensor = {"type": "orthographic", "to_world": to_world(scale), "film": film(**crop)}
        for sample in (Sample(), SAMPLE):
            assert_rays_meet_their_pixels(view_of(sensor), sample)


def test_a_sheared_orthographic_sensor_is_refused():
    sheared: Any = np.eye(4) + 0.3 * np.eye(4, k=1)
    sheared[2, 3] = 0
    with pytest.raises(ValueError, match="not a rotation"):
        view_of({"type": "orthographic", "to_world": mi.ScalarTransform4f(sheared), "film": film()})


def test_a_border_of_samples_lies_around_the_crop_window():
    sensor = sensor_dict(square_camera(), **CROP)
    assert_rays_meet_their_pixels(view_of(sensor), SAMPLE, border=3)
    whole, camera = view_of(sensor).camera, view_of(sensor).through(Sample(), border=3).camera
    assert (camera.width, camera.height) == (whole.width + 6, whole.height + 6)


# Pictures

def picture(sensor: dict[str, Any], splats=MODEL, spp=0, **integrator) -> np.ndarray:
    scene: Any = mi.load_dict({"type": "scene", "splats": dog_dict(splats), "sensor": sensor,
                               "integrator": {"type": "dogsplat", "srgb_primitives": False, **integrator}})
    return np.array(mi.render(scene, spp=spp))


def test_an_orthographic_view_is_that_of_a_pinhole_very_far_away():
    width, distance = 2.2, 1e4
    turn = ROTATION @ np.diag([-1, 1, -1])  # looks back at the model
    pose = affine(turn, ROTATION @ (0, 0, 6.0) + MODEL.means.mean(0))
    scaled: Any = pose @ np.diag([width, width, 1, 1])
    got = picture({"type": "orthographic", "to_world": mi.ScalarTransform4f(scaled), "film": film()})
    f = 0.5 * 64 / width * distance
    mitsuba_from_opencv = np.diag([-1.0, -1, 1, 1])
    far = pose.copy()
    far[:3, 3] -= pose[:3, 2] * (distance - 3)
    camera = Camera(np.linalg.inv(far @ mitsuba_from_opencv), f, f, 32, 24, 64, 48)
    expected = reference.render(MODEL, camera)[0]
    assert expected.std() > 0.05
    assert np.abs(got - expected).max() < 0.01 and np.abs(got - expected).mean() < 5e-4


def test_what_is_in_focus_is_as_sharp_as_by_a_pinhole_and_the_rest_is_the_mean_over_the_lens():
    """Two discs facing the camera; the oracle shifts the float64 camera over a grid of lens points."""
    splats: Any = select(random_splats(2, seed=0, degree=0, dog_share=0), 2)
    splats.means[:], splats.log_scales[:], splats.logit_opacities[:] = [[-0.5, 0, 2], [0.9, 0, 4]], np.log(0.15), 1
    radius, focus, f = 0.15, 2.0, 40.0
    fov = float(np.degrees(2 * np.arctan(32 / f)))
    lens = {"type": "thinlens", "fov": fov, "aperture_radius": radius, "focus_distance": focus,
            "to_world": mi.ScalarTransform4f(np.diag([-1.0, -1, 1, 1])), "film": film()}  # type: ignore[arg-type]
    got = picture(lens, splats, spp=256)
    sharp = picture({**lens, "aperture_radius": 1e-6}, splats, spp=256)
    angles, radii = np.linspace(0, 2 * np.pi, 12, endpoint=False), np.sqrt((np.arange(6) + 0.5) / 6) * radius
    expected = np.zeros((48, 64, 3))
    shifts = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)]
    for r, a, (x, y) in itertools.product(radii, angles, shifts):
        p = np.array([r * np.cos(a), r * np.sin(a)])
        w2c = affine(np.eye(3), (*-p, 0))
        center = np.array([32, 24]) + f * p / focus + 0.5 - (x, y)
        expected += reference.render(splats, Camera(w2c, f, f, center[0], center[1], 64, 48))[0]
    expected /= len(radii) * len(angles) * len(shifts)
    assert np.abs(got - expected).mean() < 1e-3 and np.abs(got - expected).max() < 0.02
    assert np.abs(got - sharp)[:, :32].max() < 0.02 < 0.05 < np.abs(got - sharp)[:, 32:].max()


def test_a_lens_without_a_sample_count_takes_that_of_the_sampler():
    lens = {"type": "thinlens", "fov": 40.0, "aperture_radius": 0.1, "focus_distance": 2.0, "film": film(),
            "sampler": {"type": "independent", "sample_count": 7}}
    np.testing.assert_array_equal(picture(lens), picture(lens, spp=7))
    assert np.abs(picture(lens) - picture(lens, spp=8)).max() > 1e-4


def test_the_near_clip_of_sensor_and_integrator_both_hold():
    def near(sensor_clip, integrator_clip):
        camera = {**sensor_dict(square_camera()), "near_clip": sensor_clip}
        return picture(camera, near_clip=integrator_clip)

    np.testing.assert_array_equal(near(0.01, 2.5), near(2.5, 0.2))
    assert np.abs(near(0.01, 2.5) - near(0.01, 0.2)).max() > 0.1


@pytest.mark.parametrize("name", ["near_clip", "far_clip"])
def test_the_clips_of_an_orthographic_sensor_are_scaled_as_mitsuba_scales_them(name):
    def clipped(scale: float, clip: float):
        return picture({"type": "orthographic", name: clip, "film": film(),
                        "to_world": mi.ScalarTransform4f().scale([1, 1, scale])})

    np.testing.assert_array_equal(clipped(2.0, 1.25), clipped(1.0, 2.5))
    assert np.abs(clipped(2.0, 1.25) - clipped(1.0, 1.25)).max() > 0.1


@pytest.mark.parametrize("spp", [1, 3])
@pytest.mark.parametrize("kind", ["perspective", "orthographic", "thinlens"])
def test_primitives_whose_centre_is_beyond_the_far_clip_are_dropped(kind, spp):
    lens = {"aperture_radius": 0.1, "focus_distance": 2.0} if kind == "thinlens" else {}
    sensor = {"type": kind, "film": film(), **lens}
    camera = Camera(np.eye(4), 40.0, 40.0, 32, 24, 64, 48)
    sensor |= {"to_world": mi.ScalarTransform4f(OPENCV_FROM_MITSUBA)}
    kept = MODEL.select(np.flatnonzero(camera.project(MODEL.means)[1] <= 2.5))
    assert 5 < kept.n_splats < 55
    expected = picture(sensor, kept, spp)
    np.testing.assert_allclose(picture({**sensor, "far_clip": 2.5}, MODEL, spp), expected, atol=1e-6)
    assert np.abs(picture(sensor, MODEL, spp) - expected).max() > 0.1


def test_the_far_clip_may_change_between_renders_and_holds_for_derivatives_too():
    scene = scene_of(MODEL, square_camera())
    params: Any = mi.traverse(scene)
    dr.enable_grad(params["splats.sh_coeffs"])
    depth = square_camera().project(MODEL.means)[1]
    for far_clip in (10.0, 2.5, 3.5):
        params["sensor.far_clip"] = far_clip
        params.update()
        dr.clear_grad(params["splats.sh_coeffs"])
        dr.backward(dr.sum(mi.render(scene, params), axis=None))
        reached = dr.grad(params["splats.sh_coeffs"]).numpy().any((1, 2))
        assert not reached[depth > far_clip].any() and reached[depth <= far_clip].mean() > 0.3


# Batches

CAMERAS = [square_camera(), square_camera(f=50.0), square_camera(cx=10, cy=22)]


def batch(**others) -> dict[str, Any]:
    sensors = {f"view{k}": sensor_dict(camera) for k, camera in enumerate(CAMERAS)}
    return {"type": "batch", "film": film(3 * 40, 30, **others), **sensors}


@pytest.mark.parametrize("spp", [1, 4])
def test_a_batch_renders_its_views_side_by_side(spp):
    got = picture(batch(), spp=spp)
    assert got.shape == (30, 120, 3)
    single = [picture(sensor_dict(camera), spp=spp) for camera in CAMERAS]
    np.testing.assert_allclose(got, np.concatenate(single, 1), atol=1e-6)


def test_a_batch_is_derived_as_its_views_are():
    def gradient(sensor, adjoint):
        scene = scene_of(MODEL, CAMERAS[0])
        params: Any = mi.traverse(scene)
        dr.enable_grad(params["splats.means"])
        params.update()
        dr.backward(dr.sum(mi.render(scene, params, sensor=mi.load_dict(sensor)) * mi.TensorXf(adjoint), axis=None))
        return dr.grad(params["splats.means"]).numpy()

    adjoint = np.random.default_rng(0).normal(size=(30, 120, 3)).astype(np.float32)
    parts = [gradient(sensor_dict(c), adjoint[:, 40 * k:40 * k + 40]) for k, c in enumerate(CAMERAS)]
    expected = np.sum(parts, axis=0)
    np.testing.assert_allclose(gradient(batch(), adjoint), expected, atol=1e-4 * np.abs(expected).max())


def test_a_batch_may_hold_cameras_of_several_kinds_but_none_that_cannot_be_splatted():
    mixed = {"type": "batch", "film": film(128, 48), "near": sensor_dict(square_camera(64, 48)),
             "far": {"type": "orthographic", "film": film()}}
    expected = [picture(mixed["near"]), picture(mixed["far"])]
    np.testing.assert_allclose(picture(mixed), np.concatenate(expected, 1), atol=1e-6)
    meter = {"type": "radiancemeter", "film": film(1, 1)}
    with pytest.raises(RuntimeError) as failed:
        picture({"type": "batch", "film": film(2, 1), "a": sensor_dict(square_camera(1, 1)), "b": meter})
    assert "RadianceMeter" in str(failed.value.__cause__)


@pytest.mark.parametrize("chosen", [{"sample_border": True}, CROP], ids=["border", "crop window"])
def test_a_batch_of_views_that_would_not_fit_together_is_refused_in_one_line(chosen):
    with pytest.raises(RuntimeError) as failed:
        picture(batch() | {"film": film(120, 30, **chosen)}, spp=4)
    assert "a batch has no sample_border and no crop window" in str(failed.value.__cause__)


def test_a_batch_that_shares_its_film_with_its_sensors_is_refused_in_one_line():
    """As Mitsuba makes it of a file in which they have equal ones; its width is that of one view then."""
    shared = mi.load_dict(film(80, 30))
    views = {f"view{k}": sensor_dict(CAMERAS[k]) | {"film": shared} for k in (0, 1)}
    with pytest.raises(RuntimeError) as failed:
        picture({"type": "batch", "film": shared, **views})
    assert "give films to the batch alone" in str(failed.value.__cause__)


@pytest.mark.parametrize("changed", [{"aperture_radius": 0.4}, {"focus_distance": 4.0}], ids=str)
def test_the_derivative_after_a_change_of_the_lens_is_that_of_the_new_one(changed):
    """The pinhole of the sensor is the same, so that the stages of the picture before it could be taken for its own."""
    lens = {"type": "thinlens", "to_world": mi.ScalarTransform4f(np.diag([-1.0, -1, 1, 1])),  # type: ignore[arg-type]
            "fov": 50.0, "aperture_radius": 0.01, "focus_distance": 2.5, "film": film(40, 30)}

    def gradient(sensor, before):
        scene = scene_of(MODEL, square_camera())
        params: Any = mi.traverse(scene)
        integrator: Any = scene.integrator()
        lens: Any = mi.traverse(sensor)
        dr.enable_grad(params["splats.means"])
        params.update()
        if before:
            integrator.render(scene, sensor, seed=0, spp=2)
        for name, value in changed.items():
            lens[name] = value
        lens.update()
        integrator.render_backward(scene, params, dr.ones(mi.TensorXf, (30, 40, 3)), sensor, seed=0, spp=2)
        return dr.grad(params["splats.means"]).numpy()

    got, expected = (gradient(mi.load_dict(lens), before) for before in (True, False))
    np.testing.assert_allclose(got, expected, atol=1e-4 * np.abs(expected).max())
