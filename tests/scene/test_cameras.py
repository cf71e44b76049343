"""Cameras: projection, downscaling, and conversions checked against rays that Mitsuba itself shoots."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.scene.cameras import Camera, affine, nearest_rigid, opengl_c2w_to_opencv_w2c
from mi_dogsplat.scene.mitsuba_cameras import (
    camera_from_mitsuba,
    camera_to_mitsuba,
    mitsuba_c2w_to_opencv_w2c,
    near_clip_from_mitsuba,
    opencv_w2c_to_mitsuba_c2w,
)

LLVM = Path("/usr/lib/x86_64-linux-gnu/libLLVM-19.so")
FILM = {"type": "hdrfilm", "width": 100, "height": 60}
CROP = {"crop_width": 40, "crop_height": 30, "crop_offset_x": 20, "crop_offset_y": 10}


def rotation(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def some_camera(width: int = 64, height: int = 48, **changes) -> Camera:
    w2c = affine(rotation(np.random.default_rng(3)), (0.3, -0.2, 2.0))
    values = {"fx": 70.0, "fy": 70.0, "cx": 0.4 * width, "cy": 0.55 * height}
    return Camera(w2c, **{**values, **changes}, width=width, height=height)


def mitsuba(variant: str):
    mi = pytest.importorskip("mitsuba")
    if variant.startswith("llvm") and "DRJIT_LIBLLVM_PATH" not in os.environ:
        if not LLVM.exists():
            pytest.skip(f"{variant} needs {LLVM}; set DRJIT_LIBLLVM_PATH to an LLVM of at least 17")
        os.environ["DRJIT_LIBLLVM_PATH"] = str(LLVM)
    mi.set_variant(variant)
    return mi


def points_on_rays(sensor, samples: np.ndarray) -> np.ndarray:
    """World points that the sensor sees at film positions [P, 2] in 0..1 of the crop, at varied distances."""
    import mitsuba as mi

    # one ray a call, or all rays in one: in a kernel of its own each would be compiled
    together: Any = samples if str(mi.variant()).startswith("scalar") else [mi.Point2f(samples.T.astype(np.float32))]
    rays = [sensor.sample_ray(0.0, 0.5, at, [0.5, 0.5])[0] for at in together]
    origins, directions = (
        np.concatenate([np.array(values, np.float64).reshape(3, -1) for values in of_rays], axis=1).T
        for of_rays in ([ray.o for ray in rays], [ray.d for ray in rays])
    )
    return origins + directions * (1 + np.arange(len(samples)) % 5)[:, None]


def pixel_grid(width: int, height: int, step: int = 7) -> np.ndarray:
    """Pixel centres [P, 2], corners of the image included."""
    x, y = ([*range(0, n, step), n - 1] for n in (width, height))
    return np.array([(i + 0.5, j + 0.5) for j in y for i in x])


def assert_same_pixels(sensor, camera: Camera, tolerance: float = 1e-3) -> None:
    size = (camera.width, camera.height)
    pixels = pixel_grid(*size)
    projected, depth = camera.project(points_on_rays(sensor, pixels / size))
    assert (depth > 0).all()
    assert np.abs(projected - pixels).max() < tolerance


def test_a_point_on_the_axis_projects_to_the_principal_point_and_depth_is_the_distance():
    camera = some_camera()
    forward = camera.c2w[:3, 2]
    pixels, depth = camera.project([camera.position + 3 * forward, camera.position - 2 * forward])
    np.testing.assert_allclose(pixels[0], (camera.cx, camera.cy))
    np.testing.assert_allclose(depth, (3, -2))


def test_x_points_right_and_y_points_down_and_points_behind_make_no_warning():
    camera = Camera(np.eye(4), 10, 20, 4, 3, 8, 6)
    pixels, depth = camera.project([(0.1, 0.2, 1), (0, 0, 0)])
    np.testing.assert_allclose(pixels[0], (5, 7))
    assert depth[1] == 0


def test_c2w_K_and_position_agree_with_w2c_and_project():
    camera = some_camera()
    np.testing.assert_allclose(camera.c2w @ camera.w2c, np.eye(4), atol=1e-14)
    np.testing.assert_allclose(camera.c2w[:3, 3], camera.position)
    point = camera.position + camera.c2w[:3, :3] @ (0.2, 0.1, 1)
    homogeneous = camera.K @ (0.2, 0.1, 1)
    np.testing.assert_allclose(camera.project(point)[0][0], homogeneous[:2] / homogeneous[2])


def test_what_is_unprojected_projects_to_its_pixels_at_its_depth():
    camera, rng = some_camera(fy=55.0), np.random.default_rng(1)
    pixels, depth = rng.uniform(-20, 90, (4, 5, 2)), rng.uniform(0.1, 9, (4, 5))
    points = camera.unproject(pixels, depth.astype(np.float32))
    assert points.shape == (4, 5, 3) and points.dtype == np.float64
    back, z = camera.project(points)
    np.testing.assert_allclose(back.reshape(4, 5, 2), pixels, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(z.reshape(4, 5).astype(np.float32), depth.astype(np.float32))


def test_a_downscaled_camera_cuts_the_remainder_and_divides_pixel_positions_by_exactly_k():
    camera = some_camera(67, 50)
    small = camera.downscaled(4)
    assert (small.width, small.height) == (16, 12)
    points = np.random.default_rng(0).normal(size=(9, 3))
    np.testing.assert_allclose(small.project(points)[0], camera.project(points)[0] / 4)


def test_a_resized_camera_scales_each_axis_by_its_exact_ratio():
    camera = some_camera(67, 50)
    points = np.random.default_rng(0).normal(size=(9, 3))
    expected = camera.project(points)[0] * (17 / 67, 13 / 50)
    np.testing.assert_allclose(camera.resized(17, 13).project(points)[0], expected)


@pytest.mark.parametrize(
    "changes", [{"fx": 0.0}, {"fy": -1.0}, {"cx": np.nan}, {"width": 0}, {"height": -3}], ids=str
)
def test_a_camera_refuses_values_that_are_no_pinhole(changes):
    with pytest.raises(ValueError, match="Camera"):
        some_camera(**changes)


def test_a_camera_refuses_a_pose_of_the_wrong_shape_or_with_nan_and_cannot_be_changed():
    with pytest.raises(ValueError, match=r"\(3, 4\)"):
        Camera(np.eye(4)[:3], 1, 1, 1, 1, 2, 2)
    with pytest.raises(ValueError, match="finite"):
        Camera(np.full((4, 4), np.nan), 1, 1, 1, 1, 2, 2)
    with pytest.raises(ValueError):
        some_camera().w2c[0, 0] = 2
    with pytest.raises(ValueError, match="downscaled by 100"):
        some_camera().downscaled(100)


def test_opengl_poses_look_along_minus_z_with_y_up():
    camera = Camera(opengl_c2w_to_opencv_w2c(affine(np.eye(3), (1, 2, 3))), 10, 10, 0, 0, 1, 1)
    np.testing.assert_allclose(camera.position, (1, 2, 3))
    pixels, depth = camera.project([(1, 2.5, 1)])  # ahead by 2, up by 0.5
    np.testing.assert_allclose((*pixels[0], depth[0]), (0, -2.5, 2))


def test_mitsuba_poses_look_along_z_with_x_left_and_the_way_back_is_exact():
    camera = Camera(mitsuba_c2w_to_opencv_w2c(np.eye(4)), 10, 10, 0, 0, 1, 1)
    pixels, depth = camera.project([(1, 0.5, 2)])  # left by 1, up by 0.5, ahead by 2
    np.testing.assert_allclose((*pixels[0], depth[0]), (-5, -2.5, 2))
    w2c = some_camera().w2c
    np.testing.assert_allclose(mitsuba_c2w_to_opencv_w2c(opencv_w2c_to_mitsuba_c2w(w2c)), w2c, atol=1e-14)


def test_rounding_in_a_pose_is_repaired_but_scale_shear_and_reflection_are_refused():
    exact = some_camera().c2w
    repaired = nearest_rigid(
        exact + 2e-4 * np.random.default_rng(0).uniform(-1, 1, (4, 4)) * (np.arange(4) < 3)[:, None]
    )
    np.testing.assert_allclose(repaired[:3, :3] @ repaired[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(repaired, exact, atol=1e-3)
    with pytest.raises(ValueError, match="not a rotation"):
        nearest_rigid(exact @ np.diag([1.01, 1.01, 1.01, 1]))
    with pytest.raises(ValueError, match="reflection"):
        nearest_rigid(exact @ np.diag([-1, 1, 1, 1]))
    with pytest.raises(ValueError, match="last row"):
        nearest_rigid(exact.T)
    with pytest.raises(ValueError, match="shape"):
        nearest_rigid(np.eye(3))


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_rgb"])
@pytest.mark.parametrize(
    "settings",
    [
        {"fov": 40.0},
        {"fov": 40.0, "fov_axis": "y"},
        {"fov": 50.0, "fov_axis": "diagonal"},
        {"focal_length": "35mm"},
        {"fov": 40.0, "principal_point_offset_x": 0.1, "principal_point_offset_y": -0.07},
        {"fov": 40.0, "fov_axis": "smaller", "principal_point_offset_x": -0.2, "film": {**FILM, **CROP}},
    ],
    ids=str,
)
def test_points_on_mitsubas_rays_project_to_the_pixels_they_left(variant, settings):
    mi = mitsuba(variant)
    pose = mi.ScalarTransform4f().look_at(origin=[1, 2, 3], target=[0.2, 0, 0], up=[0.1, 1, 0])
    sensor = mi.load_dict(
        {"type": "perspective", "to_world": pose, "film": FILM, "near_clip": 0.25, **settings}
    )
    camera = camera_from_mitsuba(sensor)
    assert_same_pixels(sensor, camera)
    np.testing.assert_allclose(camera.position, (1, 2, 3), atol=1e-6)
    assert near_clip_from_mitsuba(sensor) == 0.25


def test_a_mirrored_mitsuba_sensor_stays_mirrored():
    mi = mitsuba("scalar_rgb")
    pose = mi.ScalarTransform4f().look_at(origin=[1, 2, 3], target=[0, 0, 0], up=[0, 1, 0]).scale([-1, 1, 1])
    sensor = mi.load_dict({"type": "perspective", "to_world": pose, "film": FILM, "fov": 30})
    camera = camera_from_mitsuba(sensor)
    assert np.linalg.det(camera.w2c) < 0
    assert_same_pixels(sensor, camera)
    assert_same_pixels(mi.load_dict(camera_to_mitsuba(camera)), camera)


def test_a_camera_as_mitsuba_sensor_sees_the_same_pixels_and_converts_back():
    mi = mitsuba("scalar_rgb")
    camera = some_camera()
    sensor = mi.load_dict(camera_to_mitsuba(camera, near_clip=0.5, far_clip=50))
    assert_same_pixels(sensor, camera)
    assert near_clip_from_mitsuba(sensor) == 0.5
    back = camera_from_mitsuba(sensor)
    assert (back.width, back.height) == (camera.width, camera.height)
    np.testing.assert_allclose(back.K, camera.K, rtol=1e-5)
    np.testing.assert_allclose(back.w2c, camera.w2c, atol=1e-6)


def test_almost_square_pixels_are_shared_out_and_other_ones_are_refused():
    mi = mitsuba("scalar_rgb")
    camera = some_camera(fx=70.0, fy=70.0 * (1 + 7e-4))
    bound = 0.5 * 7e-4 * 64  # half the difference times the distance from the principal point
    assert_same_pixels(mi.load_dict(camera_to_mitsuba(camera)), camera, tolerance=bound)
    with pytest.raises(ValueError, match="square"):
        camera_to_mitsuba(some_camera(fx=70.0, fy=71.0))


@pytest.mark.parametrize("kind", ["thinlens", "orthographic"])
def test_a_sensor_that_is_no_pinhole_is_refused_with_the_kind_that_works(kind):
    mi = mitsuba("scalar_rgb")
    lens = {"aperture_radius": 0.1, "focus_distance": 1.0, "fov": 40.0} if kind == "thinlens" else {}
    with pytest.raises(ValueError, match="perspective"):
        camera_from_mitsuba(mi.load_dict({"type": kind, "film": FILM, **lens}))
