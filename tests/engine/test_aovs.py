"""AOVs through ``mi.render`` against their float64 twins, which walk no tiles and share no formula with the kernels."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.aovs import AOVS, channel_names
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.normals import normals
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.plugin.splat_integrator import dog_shapes
from mi_dogsplat.reference import aovs as reference_aovs
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.splats import Splats
from read_together import read, read_gradients
from same_numbers import assert_same_numbers
from splat_scenes import (
    assert_gradients_equal,
    axis_rotation,
    differences,
    dog_dict,
    make_splats,
    random_splats,
    rounded,
    scene_of,
    sensor_dict,
    square_camera,
    tilted_camera,
)

EVERYTHING = ",".join(AOVS)
CAMERA = square_camera()
CLEAR = 1e-3  # a pixel whose decisions are clearer than that must be the same in float32
SOLID = 0.02  # depth and normal are ratios by alpha, or directions of a sum: rounding shows where it is nearly 0


def engine(splats: Splats, camera: Camera = CAMERA, aovs=EVERYTHING, **choices) -> dict[str, np.ndarray]:
    """[H, W] planes by name, ``normal`` [H, W, 3]."""
    image = np.array(mi.render(scene_of(splats, camera, aovs=aovs, **choices)))[..., 3:]
    names = aovs.split(",")
    ends = np.cumsum([len(channel_names([name])) for name in names])
    assert image.shape == (camera.height, camera.width, ends[-1])
    return {name: part.squeeze(-1) if part.shape[-1] == 1 else part
            for name, part in zip(names, np.split(image, ends[:-1], axis=-1), strict=True)}


def assert_as_twin(splats: Splats, camera: Camera = CAMERA, least_clear=0.9, **choices):
    got, (expected, clearness) = engine(splats, camera, **choices), reference_aovs.aovs(splats, camera, **choices)
    clear = clearness > CLEAR
    assert clear.mean() >= least_clear
    for name in ("median_depth", "index", "count", "dog_share"):
        np.testing.assert_allclose(got[name][clear], expected[name][clear], rtol=1e-4, atol=1e-4, err_msg=name)
    np.testing.assert_array_equal(got["index"], np.round(got["index"]))
    np.testing.assert_allclose(got["alpha"][clear], expected["alpha"][clear], atol=1e-4)
    solid = clear & (expected["alpha"] > SOLID)
    np.testing.assert_allclose(got["depth"][solid], expected["depth"][solid], rtol=1e-3)
    np.testing.assert_allclose(got["normal"][solid], expected["normal"][solid], atol=5e-3)
    hollow = clear & (expected["alpha"] < -1e-4)
    assert not got["depth"][hollow].any() and not got["normal"][hollow].any()
    return got, expected, clear


# --- against brute force ---


@pytest.mark.parametrize("dog_share", [0, 0.3, 1])
@pytest.mark.parametrize(("seed", "cut_shares"), [(1, (0, 0)), (2, (0, 0)), (1, (0.5, 0)), (1, (0.5, 0.5))])
def test_every_aov_is_that_of_the_twin(dog_share, seed, cut_shares):
    splats = rounded(random_splats(60, seed, 3, dog_share, 0, *cut_shares))
    got, expected, clear = assert_as_twin(splats)
    assert len(np.unique(got["index"][clear])) > 15 and got["count"][clear].max() > 5
    assert (expected["median_depth"][clear] > 0).mean() > 0.01
    assert bool(got["dog_share"].any()) == bool(dog_share)
    if dog_share == 1:
        assert (expected["alpha"][clear] < -1e-3).any()  # negative lobes in front of nothing are among the cases


@pytest.mark.parametrize(
    "choices", [{"antialiased": True}, {"near_clip": 2.5}, {"negative_transmittance": False}], ids=str
)
def test_every_choice_of_a_render_holds_for_the_aovs(choices):
    assert_as_twin(rounded(random_splats(60, seed=3)), **choices)


@pytest.mark.parametrize("width, height", [(1, 1), (1, 33), (45, 37), (17, 2)])
def test_images_of_any_size_have_aovs(width, height):
    camera = square_camera(width, height, cx=0.4 * width, cy=0.7 * height)
    assert_as_twin(rounded(random_splats(60, seed=4)), camera, least_clear=0.8)


def test_a_crop_window_is_cut_out_of_the_whole_image():
    splats, film = rounded(random_splats(60, seed=5)), {"crop_offset_x": 7, "crop_offset_y": 5}
    scene = scene_of(splats, CAMERA, aovs=EVERYTHING, film={**film, "crop_width": 20, "crop_height": 11})
    expected, clearness = reference_aovs.aovs(splats, CAMERA)
    part, clear = np.array(mi.render(scene))[..., 3:], clearness[5:16, 7:27] > CLEAR
    for name, plane in zip(("index", "count"), np.moveaxis(part[..., [6, 7]], -1, 0), strict=True):
        np.testing.assert_array_equal(plane[clear], expected[name][5:16, 7:27][clear])


@pytest.mark.parametrize("name", AOVS)
def test_an_aov_alone_is_what_it_is_among_all(name):
    splats = rounded(random_splats(60, seed=6))
    assert_same_numbers(engine(splats, aovs=name)[name], engine(splats)[name])


def test_walks_end_where_the_image_ends_them():
    """Layers of 0.97 leave 0.03 and 9e-4; one more would fall below 1e-4, and is not blended."""
    rng, n = np.random.default_rng(0), 30
    means = np.column_stack([rng.uniform(-0.2, 0.2, (n, 2)), np.linspace(1.5, 4, n)])
    for dog in ((), range(2, n)):
        splats = rounded(make_splats(means, 0.3, 0.97, dog=dog))
        got, *_ = assert_as_twin(splats, Camera(np.eye(4), 36, 36, 20, 15, 40, 30), least_clear=0.8)
        assert got["count"][12:18, 16:24].min() < 20  # of 30 that all reach these pixels

    walls = rounded(make_splats([[0, 0, 2 + k / 10] for k in range(20)], 1e4, 0.97))
    got = engine(walls, Camera(np.eye(4), 36, 36, 20, 15, 40, 30))
    assert (got["count"] == 2).all() and (got["index"] == 0).all()
    np.testing.assert_allclose(got["median_depth"], 2)


# --- where nothing is ---


@pytest.mark.parametrize("n", [0, 1])
def test_where_nothing_is_seen_the_index_is_minus_one_and_all_else_is_zero(n):
    """No primitive at all, and one that is behind the camera."""
    behind = rounded(make_splats([0, 0, -2], 0.3, 0.9, dog=[0]))
    got = engine(behind.select(np.arange(n)), Camera(np.eye(4), 36, 36, 20, 15, 40, 30))
    for name, plane in got.items():
        assert (plane == (-1 if name == "index" else 0)).all(), name


def test_pixels_beside_a_primitive_are_empty():
    splats = rounded(make_splats([0, 0, 2], 0.05, 0.9, dog=[0]))
    got, expected, clear = assert_as_twin(splats, Camera(np.eye(4), 36, 36, 20, 15, 40, 30))
    empty = clear & (expected["count"] == 0)
    assert 0.5 < empty.mean() < 1
    for name, plane in got.items():
        assert (plane[empty] == (-1 if name == "index" else 0)).all(), name


def test_a_negative_lobe_alone_is_counted_but_is_nobodys_index():
    """A pseudo-Gaussian that is wider than its primary, seen where only it is left."""
    splats = rounded(make_splats([0, 0, 2], 0.05, 0.9, dog=[0], f_a=0.5, F=6))
    got, expected, clear = assert_as_twin(splats, Camera(np.eye(4), 36, 36, 20, 15, 40, 30))
    lobe = clear & (expected["alpha"] < -0.01)
    assert lobe.any()
    assert (got["index"][lobe] == -1).all() and (got["count"][lobe] == 1).all()
    assert_same_numbers(got["dog_share"][lobe], 1)
    assert not got["depth"][lobe].any() and not got["normal"][lobe].any() and not got["median_depth"][lobe].any()


# --- what they mean ---


def test_the_median_depth_is_that_of_the_layer_that_stops_half_of_the_light():
    walls = rounded(make_splats([[0, 0, z] for z in (5, 3, 4, 2)], 1e4, [0.9, 0.4, 0.3, 0.1]))
    got = engine(walls, Camera(np.eye(4), 36, 36, 20, 15, 40, 30))  # T: .9, .54, .378, .0378
    np.testing.assert_allclose(got["median_depth"], 4, rtol=1e-6)
    weights = {3: 0.1, 1: 0.9 * 0.4, 2: 0.54 * 0.3, 0: 0.378 * 0.9}
    assert (got["index"] == max(weights, key=lambda i: weights[i])).all() and (got["count"] == 4).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_normal_is_the_shortest_axis_in_world_space_turned_to_the_camera(axis):
    rotation, quat = axis_rotation([1, -2, 0.4], 0.8)
    scales = np.full(3, 0.5)
    scales[axis] = 0.01
    world, _ = axis_rotation([0.2, 1, 0.3], 1.1)
    camera = Camera(affine(world, world @ [-3, 1, -2]), 36, 36, 20, 15, 40, 30)  # centre (3, -1, 2)
    mean = camera.position + world.T @ [0, 0, 2]
    got = engine(rounded(make_splats(mean, scales, 0.9, quats=quat)), camera)["normal"]
    seen = np.linalg.norm(got, axis=-1) > 0
    expected = rotation[:, axis] * -np.sign(rotation[:, axis] @ (mean - camera.position))
    assert seen.any()
    np.testing.assert_allclose(got[seen], np.broadcast_to(expected, got[seen].shape), atol=1e-5)


def test_along_parallel_rays_normals_are_turned_against_the_optical_axis():
    camera = tilted_camera()
    found = normals(upload(rounded(random_splats(40, seed=2))), DeviceCamera.upload(camera, perspective=False))
    axes = np.stack(read(found), -1)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1, rtol=1e-5)
    assert (axes @ camera.w2c[2, :3] < 1e-6).all()


def test_the_share_of_dog_is_that_of_the_sizes_of_the_weights():
    """In front a negative wall of α = .1 - .3, behind it a plain one of .5 that it amplifies."""
    walls = rounded(make_splats([[0, 0, 2], [0, 0, 3]], 1e4, [0.6, 0.5], dog=[0], f_a=0.5, F=1))
    got = engine(walls, Camera(np.eye(4), 36, 36, 20, 15, 40, 30))["dog_share"]
    front, back = 0.3, 0.7 * 0.5
    np.testing.assert_allclose(got, front / (front + back), rtol=1e-4)


def test_indices_count_through_all_shapes_of_the_scene():
    parts = [rounded(random_splats(n, seed=n, degree=0, dog_share=0.5)) for n in (20, 35)]
    scene = scene_of(parts[0], CAMERA, aovs="index", extra={"more": dog_dict(parts[1])})
    in_order = [shape.to_splats() for shape in dog_shapes(scene)]  # by their ids, however Mitsuba lists them
    starts = {0: 0, 1: in_order[0].n_splats}
    both = {name: np.concatenate([getattr(s, name) for s in in_order]) for name in vars(in_order[0])}
    both["dog_index"] = np.concatenate([s.dog_index + starts[k] for k, s in enumerate(in_order)])
    expected, clearness = reference_aovs.aovs(Splats(**both), CAMERA)
    got = np.array(mi.render(scene))[..., 3]
    np.testing.assert_array_equal(got[clearness > CLEAR], expected["index"][clearness > CLEAR])
    assert got.max() >= 20


# --- derivatives ---

SMALL = rounded(random_splats(10, seed=4, degree=1))
SMALL_CAMERA = square_camera(16, 12, f=14.0)
SOLID_HERE = reference_aovs.aovs(SMALL, SMALL_CAMERA)[0]["alpha"] > 0.1
ADJOINTS = {name: np.random.default_rng(k).normal(size=(12, 16, size)) * SOLID_HERE[..., None]
            for k, (name, size) in enumerate({"alpha": 1, "depth": 1, "normal": 3}.items())}


@pytest.fixture(scope="module")
def small_differences() -> dict[str, dict[str, np.ndarray]]:
    """By the name of the AOV and that of the parameter. Steps are so small that no pixel crosses a cutoff."""

    def losses(splats: Splats) -> np.ndarray:
        planes = reference_aovs.aovs(splats, SMALL_CAMERA)[0]
        return np.array([np.sum(δ * planes[name].reshape(δ.shape)) for name, δ in ADJOINTS.items()])

    found = differences(SMALL, losses, eps=1e-7, n_losses=len(ADJOINTS))
    return {name: {key: values[..., k] for key, values in found.items()} for k, name in enumerate(ADJOINTS)}


@pytest.mark.parametrize("name", ADJOINTS)
def test_derivatives_of_alpha_depth_and_normal_equal_differences(name, small_differences):
    adjoint, expected = ADJOINTS[name], dict(small_differences[name])
    scene = scene_of(SMALL, SMALL_CAMERA, aovs=f"count,{name}")
    params: Any = mi.traverse(scene)
    for key in RAW_PARAMETERS:
        dr.enable_grad(params[f"splats.{key}"])
    params.update()
    weights = np.concatenate([np.zeros((12, 16, 4)), adjoint], -1).astype(np.float32)
    dr.backward(dr.sum(mi.render(scene, params) * mi.TensorXf(weights), axis=None))
    got = read_gradients(params, RAW_PARAMETERS, "splats.")
    assert not expected.pop("sh_coeffs").any() and not got.pop("sh_coeffs").any()
    assert_gradients_equal(got, expected)


@pytest.mark.parametrize(("pixel_format", "colors"), [("rgb", 3), ("luminance", 1)])
def test_what_has_no_derivative_has_a_derivative_of_zero_and_keeps_its_value(pixel_format, colors):
    """Also where the derivative passes through a film that converts colours, and so is developed again."""
    film = {"pixel_format": pixel_format}
    scene = scene_of(SMALL, SMALL_CAMERA, aovs="median_depth,index,count,dog_share", film=film)
    params: Any = mi.traverse(scene)
    for key in RAW_PARAMETERS:
        dr.enable_grad(params[f"splats.{key}"])
    params.update()
    image = mi.render(scene, params)
    values = image.numpy().copy()
    assert values.shape == (12, 16, colors + 4)
    dr.backward(dr.sum(image[..., colors:], axis=None))
    assert not any(values.any() for values in read_gradients(params, RAW_PARAMETERS, "splats.").values())
    assert values[..., colors:].any((0, 1)).all()
    assert_same_numbers(np.array(scene.sensors()[0].film().bitmap()), values)

    dr.set_grad(params["splats.means"], dr.ones(mi.TensorXf, (10, 3)))
    params.update()
    tangents = dr.forward_to(mi.render(scene, params)).numpy()
    assert tangents[..., :colors].any() and not tangents[..., colors:].any()


# --- wrong use ---


@pytest.mark.parametrize(("aovs", "problem"), [
    ("alpha, albedo", 'unknown AOV "albedo"; available are alpha, depth, median_depth, normal, index, count'),
    ("depth,alpha,depth", 'the AOV "depth" is there twice'),
])
def test_names_that_cannot_be_are_refused(aovs, problem):
    with pytest.raises(RuntimeError, match=f"dogsplat: {problem}"):
        mi.load_dict({"type": "dogsplat", "aovs": aovs})


@pytest.mark.parametrize("outer", [{"type": "aov", "aovs": "z:depth"}, {"type": "moment"}], ids=str)
@pytest.mark.parametrize("aovs", ["", "depth"])
def test_nested_in_another_integrator_it_says_so_and_makes_no_image(outer, aovs):
    integrator = {**outer, "inner": {"type": "dogsplat", "aovs": aovs}}
    scene: Any = mi.load_dict({"type": "scene", "integrator": integrator, "splats": dog_dict(SMALL),
                               "sensor": sensor_dict(SMALL_CAMERA)})
    with pytest.raises(RuntimeError) as failed:
        mi.render(scene)
    assert "dogsplat: cannot be nested in another integrator" in str(failed.value.__cause__)


def test_indices_have_no_mean_over_samples():
    scene: Any = scene_of(SMALL, SMALL_CAMERA, aovs="index")
    with pytest.raises(RuntimeError, match='"index" has no mean over 4 samples per pixel'):
        scene.integrator().render(scene, spp=4)
    mi.render(scene_of(SMALL, SMALL_CAMERA, aovs="depth"), spp=4)
