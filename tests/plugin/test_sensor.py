"""What derivative passes take over from elsewhere: the camera of a sensor, and the film's development."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.plugin.sensor import SensorReader
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from read_together import read_gradients
from same_numbers import assert_same_numbers
from splat_scenes import (
    kernels,
    random_splats,
    rounded,
    scalar_transform,
    scene_of,
    sensor_dict,
    square_camera,
    variable_in_the_place_of,
)

CAMERA = square_camera()
MODEL = rounded(random_splats(40, seed=3, degree=1, dog_share=0.4))


def test_a_sensor_is_read_again_when_it_moves_zooms_or_another_one_is_given():
    sensor: Any = mi.load_dict(sensor_dict(CAMERA))
    reader = SensorReader()

    def read(sensor, near_clip):
        return reader.views(sensor, near_clip)[0].camera

    first = read(sensor, 0.2)
    assert read(sensor, 0.2) is first

    params: Any = mi.traverse(sensor)
    params["x_fov"] = params["x_fov"] * 1.25
    params.update()
    zoomed = read(sensor, 0.2)
    assert zoomed.numbers != first.numbers

    params["to_world"] = mi.Transform4f(scalar_transform(np.eye(4) + np.eye(4, k=3)).matrix)
    params.update()
    moved = read(sensor, 0.2)
    assert moved.numbers != zoomed.numbers
    assert read(sensor, 0.3).numbers != moved.numbers
    other: Any = mi.load_dict(sensor_dict(CAMERA))
    assert read(other, 0.2).numbers == first.numbers


@pytest.mark.parametrize("angle", [0.0, 180.0, -10.0, 200.0, np.nan])
def test_a_field_of_view_that_no_camera_has_is_named_with_its_sensor(angle):
    scene = mi.load_dict({"type": "scene", "eye": sensor_dict(CAMERA)})
    params: Any = mi.traverse(scene)
    params["eye.x_fov"] = angle
    params.update()
    with pytest.raises(ValueError, match=f'"x_fov" of the sensor "eye" is {angle:g} degrees; give a field of view'):
        SensorReader().views(scene.sensors()[0], 0.2)


def test_a_new_variable_in_the_place_of_one_that_is_gone_is_not_taken_for_it():
    sensor: Any = mi.load_dict(sensor_dict(CAMERA))
    params: Any = mi.traverse(sensor)
    reader = SensorReader()
    params["x_fov"] = dr.opaque(mi.Float, 30)
    params.update()
    index, narrow = params["x_fov"].index, reader.views(sensor, 0.2)[0].camera
    params["x_fov"] = mi.Float(70)
    params.update()
    params["x_fov"] = variable_in_the_place_of(index, 90, 1)
    params.update()
    wide = reader.views(sensor, 0.2)[0].camera
    np.testing.assert_allclose(np.array(wide.fx) / np.array(narrow.fx), np.tan(np.radians(15)), rtol=1e-5)


def test_stages_of_a_frame_are_not_recalled_for_a_new_variable_in_the_place_of_one_that_is_gone():
    scene = scene_of(MODEL, CAMERA)
    integrator: Any = scene.integrator()
    params: Any = mi.traverse(scene)
    sensor, name = scene.sensors()[0], "splats.logit_opacities"

    def gradient(rendered: bool) -> np.ndarray:
        opacities = params[name]
        dr.enable_grad(opacities)
        if rendered:
            integrator.render(scene, sensor)
        integrator.render_backward(scene, params, dr.ones(mi.TensorXf, (CAMERA.height, CAMERA.width, 3)), sensor)
        result = dr.grad(opacities).numpy().copy()
        dr.disable_grad(opacities)
        return result

    params[name] = dr.opaque(mi.TensorXf, 3, (MODEL.n_splats,))
    params.update()
    index = params[name].array.index
    opaque = gradient(rendered=True)
    integrator.render(scene, sensor)
    params[name] = dr.zeros(mi.TensorXf, (MODEL.n_splats,))
    params.update()
    params[name] = mi.TensorXf(variable_in_the_place_of(index, -3, MODEL.n_splats))
    params.update()
    alone, after_a_render = gradient(rendered=False), gradient(rendered=True)
    np.testing.assert_allclose(alone, after_a_render, rtol=1e-4, atol=1e-6)
    assert np.abs(alone - opaque).max() > 0.1 * np.abs(alone).max()


@pytest.mark.parametrize("integrator", ["dogsplat", "dogpath"])
def test_nothing_is_compiled_for_another_aperture_or_focus(integrator):
    extra: dict = {"floor": {"type": "rectangle"}} if integrator == "dogpath" else {}
    scene = scene_of(MODEL, CAMERA, type=integrator, extra=extra)
    film = {"type": "hdrfilm", "width": 40, "height": 30}
    sensor: Any = mi.load_dict({"type": "thinlens", "aperture_radius": 0.1, "focus_distance": 2.0, "film": film})
    params: Any = mi.traverse(sensor)

    def render(radius, focus):
        params["aperture_radius"], params["focus_distance"] = mi.Float(radius), mi.Float(focus)
        params.update()
        return kernels(lambda: mi.render(scene, sensor=sensor, spp=2))

    known = render(0.1, 2) | render(0.2, 3)
    assert render(0.3, 3) | render(0.3, 4) <= known


@pytest.mark.parametrize("pixel_format", ["rgb", "rgba", "luminance", "luminance_alpha", "xyz", "xyza"])
def test_the_image_that_is_derived_is_the_image_that_is_rendered(pixel_format):
    """Formats that the film hands on as they are skip it in derivative passes; the others are converted."""
    film = {"pixel_format": pixel_format, "crop_offset_x": 7, "crop_offset_y": 5, "crop_width": 20, "crop_height": 11}
    scene = scene_of(MODEL, CAMERA, film=film, aovs="alpha,depth")
    integrator: Any = scene.integrator()
    rendered = mi.render(scene).numpy()
    derived = integrator.developed(scene, scene.sensors()[0], 0, 1, derivative=True).numpy()
    assert derived.shape == rendered.shape
    assert_same_numbers(derived, rendered)


def test_a_derivative_pass_leaves_the_film_as_it_was():
    scene = scene_of(MODEL, CAMERA)
    params: Any = mi.traverse(scene)
    dr.enable_grad(params["splats.means"])
    params.update()
    image = mi.render(scene, params)
    before = np.array(scene.sensors()[0].film().bitmap())
    assert before.max() > 0
    dr.backward(dr.sum(image, axis=None))
    np.testing.assert_array_equal(np.array(scene.sensors()[0].film().bitmap()), before)


@pytest.mark.usefixtures("all_cores")
def test_adjoints_have_the_same_bits_in_every_run():
    if not lanes_add_in_turn(mi.variant()):
        pytest.skip("this backend adds the lanes of a tile with atomics, in any order")
    model = rounded(random_splats(3000, seed=5))

    def gradients() -> list[np.ndarray]:
        scene = scene_of(model, square_camera(160, 120))
        params: Any = mi.traverse(scene)
        names = [f"splats.{name}" for name in RAW_PARAMETERS]
        for name in names:
            dr.enable_grad(params[name])
        params.update()
        dr.backward(dr.sum(dr.square(mi.render(scene, params)), axis=None))
        return list(read_gradients(params, names).values())

    first = gradients()
    assert all(np.abs(values).max() > 0 for values in first)
    for _ in range(3):
        for once, again in zip(first, gradients(), strict=True):
            np.testing.assert_array_equal(once, again)
