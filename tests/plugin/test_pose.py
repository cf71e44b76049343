"""Derivatives with respect to where things are: the sensor, its lens and angle, and the shape."""

import runpy
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from launches import KernelWatch
from mi_dogsplat import reference
from mi_dogsplat.engine.motion import moved
from mi_dogsplat.engine.parameters import RAW, upload
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.mitsuba_cameras import opencv_w2c_to_mitsuba_c2w
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import transformed
from read_together import read
from same_numbers import assert_same_numbers
from splat_scenes import dog_dict, random_splats, rounded, scene_of, sensor_dict, square_camera

from benchmarks.numerics.derivative_cases import smooth_sky
from benchmarks.numerics.moved_cameras import (
    device_motion,
    far_pinhole,
    host_motion,
    lens_pinholes,
    of_moved_world,
    posed,
)

CAMERA = square_camera(16, 12, f=14.0)
MODEL = rounded(random_splats(12, seed=4, degree=2))
ADJOINT = np.random.default_rng(0).normal(size=(12, 16, 3)).astype(np.float32)
POSE = opencv_w2c_to_mitsuba_c2w(CAMERA.w2c)
FLAT: dict[str, Any] = {"srgb_primitives": False}
NAMES = ["x", "y", "z", "about x", "about y", "about z"]


def image_loss(splats: Any, camera: Camera) -> float:
    return float(np.sum(ADJOINT * reference.render(splats, camera)[0]))


def central(loss: Callable[[np.ndarray], float], n=6, eps=1e-6) -> np.ndarray:
    return np.array([(loss(eps * e) - loss(-eps * e)) / (2 * eps) for e in np.eye(n)])


def variables(n: int) -> list[mi.Float]:
    values = [mi.Float(0) for _ in range(n)]
    dr.enable_grad(values)
    return values


def gradient(scene: mi.Scene, params: Any, values: list, spp=1, adjoint=ADJOINT) -> np.ndarray:
    dr.backward(dr.sum(mi.render(scene, params, spp=spp) * mi.TensorXf(adjoint), axis=None))
    return np.concatenate(read(map(dr.grad, values)))


def assert_equal(got: np.ndarray, expected: np.ndarray, names=NAMES, rtol=5e-3):
    table = "\n".join(f"{n:>10}{g:>14.6g}{e:>14.6g}" for n, g, e in zip(names, got, expected, strict=True))
    assert np.abs(got - expected).max() < rtol * np.abs(expected).max(), "\n" + table
    assert (np.abs(got - expected) < 0.03 * np.abs(expected) + rtol / 5 * np.abs(expected).max()).all(), "\n" + table


# The sensor

def sensor_scene(p: list, **choices) -> tuple[mi.Scene, Any]:
    scene = scene_of(MODEL, CAMERA, **{**FLAT, **choices})
    params: Any = mi.traverse(scene)
    base: Any = mi.Transform4f(mi.ScalarTransform4f(POSE).matrix)
    params["sensor.to_world"] = base @ device_motion(p)
    params.update()
    return scene, params


def test_backward_mode_of_the_sensors_pose_equals_differences():
    expected = central(lambda p: image_loss(MODEL, posed(CAMERA, p)))
    values = variables(6)
    assert_equal(gradient(*sensor_scene(values), values), expected)


def test_forward_mode_of_the_sensors_pose_equals_differences():
    expected = central(lambda p: image_loss(MODEL, posed(CAMERA, p)))
    got = []
    for k in range(6):
        values = [mi.Float(0) for _ in range(6)]
        dr.enable_grad(values[k])
        dr.set_grad(values[k], 1)
        scene, params = sensor_scene(values)
        image = mi.render(scene, params, spp=1)
        dr.forward_to(image)
        got.append(float(np.sum(ADJOINT * dr.grad(image).numpy())))
    assert_equal(np.array(got), expected)


def test_the_image_is_the_same_with_and_without_derivatives_of_the_pose():
    plain = np.array(mi.render(scene_of(MODEL, CAMERA, **FLAT)))
    values = variables(6)
    scene, params = sensor_scene(values)
    np.testing.assert_allclose(np.array(mi.render(scene, params)), plain, atol=2e-5)
    integrator: Any = scene.integrator()
    primal = np.array(integrator.render(scene))
    with dr.resume_grad():
        derived = integrator.developed(scene, scene.sensors()[0], 0, 1, derivative=True)
    assert dr.grad_enabled(derived)
    assert_same_numbers(np.array(derived), primal)


def beside_the_image() -> Splats:
    """Large ones, most of them so far outside that they are linearised nearer to the image: where, the camera says."""
    splats = random_splats(12, seed=4, degree=2)
    splats.means[:, :2] *= 2
    splats.log_scales = splats.log_scales + 1.2
    return rounded(splats)


@pytest.mark.parametrize("model", [MODEL, beside_the_image()], ids=["within", "beside"])
def test_derivatives_of_angle_and_principal_point_equal_differences(model):
    scene = scene_of(model, CAMERA, **FLAT)
    params: Any = mi.traverse(scene)
    values = variables(3)
    names = ["x_fov", "principal_point_offset_x", "principal_point_offset_y"]
    fov = float(np.array(params["sensor.x_fov"])[0])
    for name, value in zip(names, values, strict=True):
        params[f"sensor.{name}"] = params[f"sensor.{name}"] + value
    params.update()

    def loss(p: np.ndarray) -> float:
        f = 8 / np.tan(np.radians(fov + p[0]) / 2)
        camera = Camera(CAMERA.w2c, f, f, CAMERA.cx - 16 * p[1], CAMERA.cy - 12 * p[2], 16, 12)
        return image_loss(model, camera)

    assert_equal(gradient(scene, params, values), central(loss, 3), names)


@pytest.mark.parametrize("spp", [1, 4])
def test_a_background_moves_with_the_pose(spp):
    sky: dict[str, Any] = {"type": "envmap", "bitmap": mi.Bitmap(smooth_sky())}

    def scene_at(p: list) -> tuple[mi.Scene, Any]:
        scene = scene_of(Splats.empty(1), square_camera(16, 12, f=5.0), extra={"sky": sky}, **FLAT)
        params: Any = mi.traverse(scene)
        base: Any = mi.Transform4f(mi.ScalarTransform4f(POSE).matrix)
        params["sensor.to_world"] = base @ device_motion(p)
        params.update()
        return scene, params

    def loss(p: np.ndarray) -> float:
        scene, _ = scene_at([mi.Float(float(v)) for v in p])
        seed: Any = mi.sample_tea_32(0, 1)[0]  # which mi.render takes for derivatives
        return float(np.sum(ADJOINT.astype(float) * np.array(mi.render(scene, spp=spp, seed=seed))))

    values = variables(6)
    got, expected = gradient(*scene_at(values), values, spp), central(loss, 6, eps=0.5)
    assert np.abs(expected[3:]).max() > 1e-3 and not expected[:3].any()
    assert_equal(got, expected, rtol=0.02)


def test_derivatives_of_an_orthographic_sensor_equal_differences():
    """The twin is a pinhole very far away, with a narrow angle."""
    sensor = {"type": "orthographic", "film": sensor_dict(CAMERA)["film"]}
    scene = scene_of(MODEL, CAMERA, extra={"flat": sensor}, **FLAT)
    params: Any = mi.traverse(scene)
    values = variables(7)
    base: Any = mi.Transform4f(mi.ScalarTransform4f(POSE).matrix)
    size = mi.Transform4f().scale(mi.Point3f(2 + values[6], 2 + values[6], 1))
    params["flat.to_world"] = base @ device_motion(values) @ size
    params.update()
    dr.backward(dr.sum(mi.render(scene, params, sensor=1, spp=1) * mi.TensorXf(ADJOINT), axis=None))
    got = np.concatenate(read(map(dr.grad, values)))

    def loss(p: np.ndarray) -> float:
        return image_loss(MODEL, far_pinhole(CAMERA, p[:6], 2 + p[6]))

    assert_equal(got, central(loss, 7), [*NAMES, "size"])


def test_derivatives_of_a_lens_equal_differences():
    """The twin averages the pinholes of the passes."""
    lens = sensor_dict(CAMERA)
    for name in ("principal_point_offset_x", "principal_point_offset_y"):
        del lens[name]
    lens |= {"type": "thinlens", "aperture_radius": 0.15, "focus_distance": 2.0}
    scene: Any = mi.load_dict({"type": "scene", "integrator": {"type": "dogsplat", **FLAT}, "sensor": lens,
                               "splats": dog_dict(MODEL)})
    params: Any = mi.traverse(scene)
    values = variables(3)
    params["sensor.aperture_radius"] = params["sensor.aperture_radius"] + values[0]
    params["sensor.focus_distance"] = params["sensor.focus_distance"] + values[1]
    base: Any = mi.Transform4f(mi.ScalarTransform4f(POSE).matrix)
    params["sensor.to_world"] = base @ mi.Transform4f().translate(mi.Point3f(values[2], 0, 0))
    params.update()
    scene.integrator().render_backward(scene, params, mi.TensorXf(ADJOINT), spp=5, seed=1)
    got = np.concatenate(read(map(dr.grad, values)))

    def loss(p: np.ndarray) -> float:
        pinholes = lens_pinholes(CAMERA, 0.15 + p[0], 2 + p[1], [p[2], 0, 0, 0, 0, 0], spp=5, seed=1)
        return float(np.mean([image_loss(MODEL, pinhole) for pinhole in pinholes]))

    assert_equal(got, central(loss, 3), ["radius", "focus", "x"])


# The shape

MOTION = np.array([0.2, -0.1, 0.3, 20.0, -35.0, 50.0])


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("scale", [1.0, 1.7, -1.7])
def test_a_model_moved_on_the_device_is_that_moved_on_the_host(degree, scale):
    splats = rounded(random_splats(30, seed=3, degree=degree))
    matrix = host_motion(MOTION) @ np.diag([scale, scale, scale, 1])
    expected = transformed(splats, matrix)
    to_world: Any = mi.Transform4f(mi.ScalarTransform4f(matrix).matrix)
    got = moved(upload(splats), to_world)
    for name in RAW:
        values = got[name].numpy().reshape(getattr(expected, name).shape)
        if name == "quats":
            values = values * np.sign((values * expected.quats).sum(1, keepdims=True))
        np.testing.assert_allclose(values, getattr(expected, name), atol=2e-5, err_msg=name)


def shape_scene(p: list) -> tuple[mi.Scene, Any]:
    scene = scene_of(MODEL, CAMERA, **FLAT)
    params: Any = mi.traverse(scene)
    params["splats.to_world"] = device_motion(p)
    params.update()
    return scene, params


def test_moving_the_shape_through_its_parameter_is_loading_it_moved():
    scene, params = shape_scene([mi.Float(float(v)) for v in MOTION / 10])
    expected = reference.render(transformed(MODEL, host_motion(MOTION / 10)), CAMERA)[0]
    assert np.abs(np.array(mi.render(scene)) - expected).mean() < 3e-5
    shape: Any = scene.shapes()[0]
    moved_means = transformed(MODEL, host_motion(MOTION / 10)).means
    np.testing.assert_allclose(shape.to_splats().means, moved_means, atol=1e-6)
    np.testing.assert_allclose(shape.bbox().min, moved_means.min(0), atol=1e-5)
    params["splats.to_world"] = mi.Transform4f()
    params.update()
    np.testing.assert_allclose(np.array(mi.render(scene)), reference.render(MODEL, CAMERA)[0], atol=2e-3)


def test_no_kernel_is_compiled_for_a_pose_of_the_shape():
    scene = scene_of(MODEL, CAMERA)
    params: Any = mi.traverse(scene)
    with KernelWatch() as kernels:
        for frame in range(1, 4):
            if frame == 3:
                kernels.forget()
            motion: Any = mi.Transform4f()
            params["splats.to_world"] = motion.translate([0.01 * frame, 0, 0]).rotate([0, 1, 0], 2.0 * frame)
            params.update()
            dr.eval(mi.render(scene))
    assert kernels.launched > 1
    assert not kernels.new


def test_a_shape_that_its_parameter_shears_is_refused():
    scene = scene_of(MODEL, CAMERA)
    params: Any = mi.traverse(scene)
    stretched: Any = mi.Transform4f()
    params["splats.to_world"] = stretched.scale([1, 2, 1])
    with pytest.raises(RuntimeError, match='"to_world" of "splats": a model can be rotated, mirrored, scaled unif'):
        params.update()


def test_backward_mode_of_the_shapes_pose_equals_differences():
    def loss(p: np.ndarray) -> float:
        return image_loss(MODEL, of_moved_world(CAMERA, p))

    values = variables(6)
    assert_equal(gradient(*shape_scene(values), values), central(loss))


def test_derivatives_by_a_pose_take_as_many_kernels_whatever_turns_with_it():
    """A sum over all primitives for each number of the pose, not for each of its uses in spherical harmonics."""
    counts = []
    for degree in (1, 2):
        params = upload(rounded(random_splats(12, seed=4, degree=degree)))
        pose = mi.Transform4f(device_motion([mi.Float(0.1)] * 6))
        dr.enable_grad(pose)
        with KernelWatch() as kernels:
            turned = moved(params, pose)
            loss: Any = sum(dr.sum(turned[name]) for name in RAW if name in turned)
            dr.backward(loss)
            dr.eval(dr.grad(pose))
        counts.append(kernels.launched)
    assert counts[0] == counts[1] > 0


def test_a_shape_that_nobody_has_moved_has_a_derivative_by_its_pose():
    scene = scene_of(MODEL, CAMERA, **FLAT)
    params: Any = mi.traverse(scene)
    dr.enable_grad(params["splats.to_world"])  # as loaded: nothing is assigned
    dr.backward(dr.sum(mi.render(scene, params, spp=1) * mi.TensorXf(ADJOINT), axis=None))
    got = dr.grad(params["splats.to_world"].matrix).numpy().reshape(4, 4)[:3, 3]
    expected = central(lambda p: image_loss(MODEL, of_moved_world(CAMERA, p)))[:3]
    assert_equal(got, expected, NAMES[:3])


def test_derivatives_of_pose_and_primitives_come_in_one_pass():
    alone_values = variables(6)
    alone = gradient(*sensor_scene(alone_values), alone_values)
    values = variables(6)
    scene, params = sensor_scene(values)
    dr.enable_grad(params["splats.means"])
    params.update()
    together = gradient(scene, params, values)
    np.testing.assert_allclose(together, alone, rtol=1e-4, atol=1e-4 * np.abs(alone).max())
    assert np.abs(dr.grad(params["splats.means"]).numpy()).max() > 0


def test_the_example_recovers_a_perturbed_camera():
    path = Path(__file__).parents[2] / "scenes" / "refine_pose.py"
    example: Any = SimpleNamespace(**runpy.run_path(str(path)))
    scene: Any = mi.load_file(str(example.SCENE))
    history = example.refine(scene, widths=(20, 40), steps=50)
    assert history[0][0] > 0.5 and history[0][1] > 5
    assert history[-1][0] < 0.01 and history[-1][1] < 0.15, history
