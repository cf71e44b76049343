"""The shape and the integrator with primitives that have SH degrees of their own."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from film_derivatives import errors_of_adam, film_gradients
from mi_dogsplat import Splats, reference, write_ply
from mi_dogsplat.engine.parameters import RAW, RAW_DOG
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.row_groups import SH
from mi_dogsplat.scene.transform import transformed
from splat_scenes import (
    assert_gradients_equal,
    axis_rotation,
    dog_dict,
    random_splats,
    rounded,
    scalar_transform,
    scene_of,
    square_camera,
    to_linear,
)

CAMERA = square_camera(16, 12, f=14.0)
INDICES = tuple(group.index for group in SH.values())
COEFFS = tuple(name for group in SH.values() for name in group.names)
FIELDS = tuple(Splats.__dataclass_fields__)


def mixed(n=12, seed=1, **settings) -> Splats:
    return rounded(random_splats(n, seed=seed, **settings)).with_sh_degrees(np.arange(n) % 4)


def assert_equal(ours: Splats, theirs: Splats, **tolerance):
    for name in FIELDS:
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), err_msg=name, **tolerance)


SIMILARITY = affine(1.3 * axis_rotation([1, 2, -1], 0.9)[0], (0.1, 0.2, 0.5))


@pytest.mark.parametrize("source", ["tensors", "file"])
def test_groups_go_in_are_seen_and_come_out(tmp_path, source):
    write_ply(tmp_path / "model.ply", mixed(), "rows")
    file = {"type": "dog", "filename": str(tmp_path / "model.ply")}
    shape: Any = mi.load_dict(file if source == "file" else dog_dict(mixed()))
    params: Any = mi.traverse(shape)
    assert set(params.keys()) == {*RAW, *RAW_DOG, "dog_index", *INDICES, *COEFFS, "to_world"}
    assert_equal(shape.to_splats(), mixed())
    assert shape.sh_size == 16 and params["sh2_coeffs"].shape == (3, 8, 3)
    assert "sh3_index = 3" in str(shape)


def test_a_moved_shape_turns_its_groups():
    expected = transformed(mixed(), SIMILARITY)
    at_load: Any = mi.load_dict(dog_dict(mixed(), to_world=scalar_transform(SIMILARITY)))
    assert_equal(at_load.to_splats(), expected, atol=1e-5)
    later: Any = mi.load_dict(dog_dict(mixed()))
    params: Any = mi.traverse(later)
    params["to_world"] = mi.Transform4f(SIMILARITY)
    params.update()
    assert_equal(later.to_splats(), expected, atol=1e-5)
    images = [mi.render(mi.load_dict({"type": "scene", "integrator": {"type": "dogsplat"}, "splats": shape,
                                      "sensor": sensor(expected)})).numpy() for shape in (at_load, later)]
    assert images[0].max() > 0.1
    np.testing.assert_allclose(images[0], images[1], atol=1e-4)


def sensor(splats: Splats) -> dict:
    centre = splats.means.mean(0).astype(float)
    to_world = mi.ScalarTransform4f().look_at((centre - [0, 0, 4]).tolist(), centre.tolist(), [0, 1, 0])
    return {"type": "perspective", "to_world": to_world,
            "film": {"type": "hdrfilm", "width": 24, "height": 16, "pixel_format": "rgb"}}


@pytest.mark.parametrize("aovs", ["", "depth,normal,median_depth,index,count,dog_share"])
def test_pictures_are_those_of_the_model_padded_with_zeros(aovs):
    ours, padded = (mi.render(scene_of(s, CAMERA, aovs=aovs)).numpy() for s in (mixed(40), mixed(40).uniform_sh()))
    np.testing.assert_allclose(ours, padded, rtol=1e-5, atol=1e-5)


def test_a_mixed_shape_beside_others_is_drawn_as_one_model():
    parts = [mixed(12), rounded(random_splats(9, seed=4, degree=1)), mixed(8, seed=5)]
    scene = scene_of(parts[0], CAMERA, extra={f"more_{k}": dog_dict(part) for k, part in enumerate(parts[1:])})
    joined = {name: np.concatenate([getattr(p.uniform_sh(3), name) for p in parts]) for name in (*RAW, *RAW_DOG)}
    index = np.concatenate([p.dog_index + first for p, first in zip(parts, (0, 12, 21), strict=True)])
    whole = scene_of(Splats(**joined, dog_index=index), CAMERA)
    np.testing.assert_allclose(mi.render(scene).numpy(), mi.render(whole).numpy(), atol=1e-5)


def test_gradients_through_the_film_equal_differences_in_float64():
    splats = mixed(10, seed=4, degree=3)
    adjoint = np.random.default_rng(0).normal(size=(12, 16, 3)).astype(np.float32)
    got = film_gradients(scene_of(splats, CAMERA), (*RAW, *RAW_DOG, *COEFFS), adjoint)
    image = reference.render(splats, CAMERA)[0]
    step = 1e-6
    slope = (to_linear(image + step) - to_linear(image - step)) / (2 * step)
    expected = reference.loss_gradients(splats, CAMERA, adjoint * slope, smooth=False, eps=1e-7)
    assert_gradients_equal(got, expected)


@pytest.mark.parametrize("name", ["splats.to_world", "sensor.to_world"])
def test_derivatives_by_a_pose_are_those_of_the_model_padded_with_zeros(name):
    """Whose lanes are primitives all along, while each group has its own."""
    adjoint = np.random.default_rng(0).normal(size=(12, 16, 3)).astype(np.float32)
    found = []
    for splats in (mixed(10, seed=4, degree=3), mixed(10, seed=4, degree=3).uniform_sh()):
        scene = scene_of(splats, CAMERA)
        params: Any = mi.traverse(scene)
        dr.enable_grad(params[name])
        params.update()
        dr.backward(dr.sum(mi.render(scene, params, spp=1) * mi.TensorXf(adjoint), axis=None))
        found.append(dr.grad(params[name]).matrix.numpy().reshape(4, 4)[:3])
    assert np.abs(found[1]).min(initial=1, where=found[1] != 0) > 1e-3
    np.testing.assert_allclose(found[0], found[1], rtol=1e-4, atol=1e-4 * np.abs(found[1]).max())


def test_adam_finds_the_bands_of_every_group():
    splats = mixed(8, seed=3)
    target = mi.render(scene_of(splats, CAMERA))
    start = Splats(**(vars(splats) | {name: 0 * getattr(splats, name) for name in COEFFS}))
    errors = errors_of_adam(scene_of(start, CAMERA), COEFFS, target)
    assert errors[-1] < 0.1 * errors[0]


def test_groups_may_grow_shrink_and_become_empty():
    scene: Any = scene_of(mixed(), CAMERA)
    params: Any = mi.traverse(scene)
    params["splats.sh3_index"] = mi.UInt32([3])
    params["splats.sh3_coeffs"] = mi.TensorXf(mixed().sh3_coeffs[:1])
    params["splats.sh2_index"] = dr.zeros(mi.UInt32, 0)
    params["splats.sh2_coeffs"] = mi.TensorXf(np.zeros((0, 8, 3), np.float32))
    params.update()
    degrees = np.array([0, 1, 0, 3, 0, 1, 0, 0, 0, 1, 0, 0])
    expected = scene_of(mixed().with_sh_degrees(degrees), CAMERA)
    np.testing.assert_array_equal(mi.render(scene).numpy(), mi.render(expected).numpy())


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"sh1_index": mi.UInt32([1, 5, 12])}, '"sh1_index" names primitive 12, "means" has 12 rows'),
        ({"sh1_index": mi.UInt32([5, 1, 9])}, '"sh1_index" is not strictly increasing'),
        ({"sh1_index": mi.UInt32([2, 5, 9])}, 'primitive 2 is in several of "sh1_index", "sh2_index", "sh3_index"'),
        ({"sh1_index": mi.UInt32([1, 5])}, r'"sh1_coeffs" has shape \(3, 3, 3\), expected \(2, 3, 3\) to match'),
        ({"sh_coeffs": mi.TensorXf(np.zeros((12, 4, 3), np.float32))}, '"sh_coeffs" has 4 coefficients; beside groups'),
    ],
)
def test_updates_that_do_not_fit_are_refused(changes, problem):
    params: Any = mi.traverse(mi.load_dict(dog_dict(mixed())))
    for name, value in changes.items():
        params[name] = value
    with pytest.raises(RuntimeError, match=problem):
        params.update()


def test_tensors_that_do_not_fit_are_refused_at_load():
    short = {**dog_dict(mixed()), "sh2_coeffs": mi.TensorXf(mixed().sh2_coeffs[:1])}
    with pytest.raises(RuntimeError, match='"sh2_coeffs" has 1 row, "sh2_index" has 3'):
        mi.load_dict(short)
