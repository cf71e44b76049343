"""Several samples per pixel: passes moved inside the pixels, weighed by the film's reconstruction filter."""

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import OpenEXR
import pytest
from mi_dogsplat.plugin.samples import samples
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from read_together import read_gradients
from splat_scenes import assert_gradients_equal, differences, random_splats, rounded, scene_of, seen_at, square_camera

MODEL = rounded(random_splats(60, seed=1))
CAMERA = square_camera()
FLAT: dict[str, Any] = {"srgb_primitives": False}


def render(scene: mi.Scene, **choices) -> np.ndarray:
    return np.array(mi.render(scene, **choices))


def passes(splats: Splats, camera: Camera, count: int, seed: int, border=0) -> list[tuple[tuple, np.ndarray]]:
    """(place in the pixel, image with alpha) of each pass, by the float64 twin."""
    return [((s.x, s.y), seen_at(splats, camera, s.x, s.y, border)) for s in samples(count, seed)]


def box(d):
    return (np.abs(d) <= 0.5) * 1.0


def tent(d):
    return np.maximum(0, 1 - np.abs(d))


def gaussian(d, stddev=0.5):
    radius = 4 * stddev
    return np.maximum(0, np.exp(-(d**2) / (2 * stddev**2)) - np.exp(-(radius**2) / (2 * stddev**2)))


def filtered(images: list[tuple[tuple, np.ndarray]], kernel: Callable, border=0) -> np.ndarray:
    """Weighted mean over all samples around a pixel, written out."""
    height, width, channels = images[0][1].shape
    height, width = height - 2 * border, width - 2 * border
    total, weights = np.zeros((height, width, channels)), np.zeros((height, width, 1))
    for (x, y), image in images:
        for row in range(-3, 4):
            for column in range(-3, 4):
                weight = kernel(column + x - 0.5) * kernel(row + y - 0.5)
                rows, columns = np.arange(height) + row + border, np.arange(width) + column + border
                there = ((rows >= 0) & (rows < image.shape[0]))[:, None] & (columns >= 0) & (columns < image.shape[1])
                values = image[np.clip(rows, 0, image.shape[0] - 1)][:, np.clip(columns, 0, image.shape[1] - 1)]
                total += weight * there[..., None] * values
                weights += weight * there[..., None]
    return total / weights


@pytest.mark.parametrize("kernel", [box, tent, gaussian])  # as the plugins are called
@pytest.mark.parametrize("sample_border", [False, True])
def test_samples_are_weighed_by_the_filter_of_the_film(kernel, sample_border):
    film = {"rfilter": {"type": kernel.__name__}, "sample_border": sample_border, "pixel_format": "rgba"}
    scene = scene_of(MODEL, CAMERA, film=film, **FLAT)
    border = scene.sensors()[0].film().rfilter().border_size() if sample_border else 0
    expected = filtered(passes(MODEL, CAMERA, 5, seed=3, border=border), kernel, border)
    got = render(scene, spp=5, seed=3)
    assert np.abs(got - expected).mean() < 5e-5 and np.abs(got - expected).max() < 1e-2


def test_a_crop_window_is_cut_out_of_the_filtered_image_but_for_its_border():
    crop = {"crop_offset_x": 7, "crop_offset_y": 5, "crop_width": 20, "crop_height": 11}
    film = {"rfilter": {"type": "gaussian"}}
    whole = render(scene_of(MODEL, CAMERA, film=film), spp=4)
    part = render(scene_of(MODEL, CAMERA, film={**film, **crop}), spp=4)
    np.testing.assert_allclose(part[2:-2, 2:-2], whole[5:16, 7:27][2:-2, 2:-2], atol=1e-5)
    part = render(scene_of(MODEL, CAMERA, film={**film, **crop, "sample_border": True}), spp=4)
    np.testing.assert_allclose(part, whole[5:16, 7:27], atol=1e-5)


@pytest.mark.parametrize(("width", "height", "stddev"), [(5, 4, 0.8), (2, 2, 0.5), (1, 1, 0.5)])
def test_a_crop_window_smaller_than_its_filter_is_cut_out_of_the_image_too(width, height, stddev):
    """Mitsuba writes beyond a block that a sample does not reach; such a render ended the process."""
    crop = {"crop_offset_x": 7, "crop_offset_y": 5, "crop_width": width, "crop_height": height}
    film = {"rfilter": {"type": "gaussian", "stddev": stddev}}
    whole = render(scene_of(MODEL, CAMERA, film=film), spp=3)
    scene = scene_of(MODEL, CAMERA, film={**film, **crop, "sample_border": True})
    for _ in range(20):
        part = render(scene, spp=3)
    np.testing.assert_allclose(part, whole[5 : 5 + height, 7 : 7 + width], atol=1e-5)


def test_many_samples_approach_the_mean_over_the_pixel():
    shifts = (np.arange(8) + 0.5) / 8
    mean = np.zeros((30, 40, 3))
    for x in shifts:
        for y in shifts:
            mean += seen_at(MODEL, CAMERA, x, y)[..., :3] / 64
    scene = scene_of(MODEL, CAMERA, **FLAT)
    errors = [np.abs(render(scene, spp=n) - mean).mean() for n in (1, 4, 16, 64)]
    assert errors[1] < 0.7 * errors[0] and max(errors[2:]) < 0.2 * errors[0], errors


def test_places_cover_pixel_and_lens_evenly_and_follow_the_seed():
    for seed in range(3):
        places = np.array([(s.x, s.y, s.lens_x, s.lens_y) for s in samples(256, seed)])
        assert (places >= 0).all() and (places < 1).all()
        for pair in (places[:, :2], places[:, 2:]):
            cells = np.histogram2d(*pair.T, bins=8, range=[[0, 1], [0, 1]])[0]
            assert cells.std() < 1.4  # 4 on average; 2 for random places
        np.testing.assert_allclose(places.mean(0), 0.5, atol=1e-3)
        assert np.abs(np.corrcoef(places.T) - np.eye(4)).max() < 0.2
    assert samples(4, 0) == samples(4, 0) != samples(4, 1)
    scene = scene_of(MODEL, CAMERA)
    np.testing.assert_array_equal(render(scene, spp=4, seed=2), render(scene, spp=4, seed=2))
    assert np.abs(render(scene, spp=4, seed=2) - render(scene, spp=4, seed=3)).max() > 1e-4


# Films

XYZ = np.array([[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]])


@pytest.mark.parametrize("spp", [1, 4])
def test_films_of_every_pixel_format_hold_the_same_image(spp):
    def image(pixel_format):
        return render(scene_of(MODEL, CAMERA, film={"pixel_format": pixel_format}), spp=spp)

    rgb, rgba = image("rgb"), image("rgba")
    np.testing.assert_allclose(rgba[..., :3], rgb, atol=1e-6)
    np.testing.assert_allclose(image("xyz"), rgb @ XYZ.T, atol=2e-5)
    np.testing.assert_allclose(image("xyza"), np.dstack([rgb @ XYZ.T, rgba[..., 3]]), atol=2e-5)
    np.testing.assert_allclose(image("luminance")[..., 0], rgb @ XYZ[1], atol=2e-5)
    np.testing.assert_allclose(image("luminance_alpha"), np.dstack([rgb @ XYZ[1], rgba[..., 3]]), atol=2e-5)


@pytest.mark.usefixtures("two_threads")
@pytest.mark.parametrize("spp", [1, 4])
def test_a_film_with_aovs_writes_a_layer_for_each(tmp_path, spp):
    scene = scene_of(MODEL, CAMERA, film={"pixel_format": "rgba"}, aovs="alpha,depth")
    image = render(scene, spp=spp)
    file = tmp_path / "layers.exr"
    scene.sensors()[0].film().write(str(file))
    channels = OpenEXR.File(str(file), separate_channels=True).channels()
    assert set(channels) == {"R", "G", "B", "A", "alpha", "depth.Z"}
    for k, name in enumerate(("R", "G", "B", "A", "alpha", "depth.Z")):
        np.testing.assert_allclose(channels[name].pixels, image[..., k], atol=2e-3, rtol=1e-3, err_msg=name)


# Derivatives

SMALL_CAMERA = square_camera(16, 12, f=14.0)
SMALL = rounded(random_splats(7, seed=4, degree=1))
COUNT, SEED = 3, 5


@pytest.fixture(scope="module")
def adjoint() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(12, 16, 4)).astype(np.float32)


@pytest.fixture(scope="module")
def expected(adjoint) -> dict[str, np.ndarray]:
    def loss(splats: Splats) -> float:
        return float(np.sum(adjoint * filtered(passes(splats, SMALL_CAMERA, COUNT, SEED), tent)))

    return differences(SMALL, loss, eps=1e-7)


def small_scene() -> tuple[mi.Scene, Any, Any]:
    film = {"pixel_format": "rgba", "rfilter": {"type": "tent"}}
    scene = scene_of(SMALL, SMALL_CAMERA, film=film, **FLAT)
    return scene, scene.integrator(), mi.traverse(scene)


@pytest.mark.slow
def test_backward_mode_at_several_samples_equals_differences(expected, adjoint):
    scene, integrator, params = small_scene()
    for name in RAW_PARAMETERS:
        dr.enable_grad(params[f"splats.{name}"])
    params.update()
    before = render(scene, spp=COUNT, seed=SEED)
    integrator.render_backward(scene, params, mi.TensorXf(adjoint), spp=COUNT, seed=SEED)
    got = read_gradients(params, RAW_PARAMETERS, "splats.")
    assert_gradients_equal(got, expected)
    np.testing.assert_allclose(np.array(scene.sensors()[0].film().develop()), before, atol=1e-6)


@pytest.mark.parametrize("name", RAW_PARAMETERS)
def test_forward_mode_at_several_samples_is_adjoint_to_the_differences(expected, adjoint, name):
    scene, integrator, params = small_scene()
    direction = np.random.default_rng(1).normal(size=getattr(SMALL, name).shape).astype(np.float32)
    dr.enable_grad(params[f"splats.{name}"])
    dr.set_grad(params[f"splats.{name}"], mi.TensorXf(direction))
    params.update()
    tangent = integrator.render_forward(scene, params, spp=COUNT, seed=SEED)
    terms = expected[name] * direction
    assert abs(np.sum(adjoint * tangent.numpy()) - terms.sum()) < 1e-2 * np.abs(terms).sum()


@pytest.mark.parametrize("pixel_format", ["luminance", "xyza"])
def test_films_that_convert_colours_are_derived_and_left_as_they_were(pixel_format):
    scene = scene_of(SMALL, SMALL_CAMERA, film={"pixel_format": pixel_format})
    params: Any = mi.traverse(scene)
    integrator: Any = scene.integrator()
    image = mi.render(scene, spp=4)
    δ = np.random.default_rng(0).normal(size=image.shape).astype(np.float32)
    rgba = scene_of(SMALL, SMALL_CAMERA, film={"pixel_format": "rgba"})
    others: Any = mi.traverse(rgba)
    for each in (params, others):
        dr.enable_grad(each["splats.means"])
        each.update()
    integrator.render_backward(scene, params, mi.TensorXf(δ), spp=4)
    δ_rgb = δ @ XYZ[1:2] if pixel_format == "luminance" else δ[..., :3] @ XYZ
    δ_alpha = np.zeros((12, 16)) if pixel_format == "luminance" else δ[..., 3]
    integrator.render_backward(rgba, others, mi.TensorXf(np.dstack([δ_rgb, δ_alpha]).astype(np.float32)), spp=4)
    a, b = (dr.grad(each["splats.means"]).numpy() for each in (params, others))
    assert np.abs(b).max() > 0.1 and np.abs(a - b).max() < 1e-3 * np.abs(b).max()
    np.testing.assert_array_equal(np.array(scene.sensors()[0].film().develop()), np.array(image))


def test_gradients_through_mi_render_at_several_samples_add_up_over_renders():
    def gradient(renders: int) -> np.ndarray:
        scene, _, params = small_scene()
        dr.enable_grad(params["splats.means"])
        params.update()
        for _ in range(renders):
            dr.backward(dr.sum(mi.render(scene, params, spp=4), axis=None))
        return dr.grad(params["splats.means"]).numpy()

    once, twice = gradient(1), gradient(2)
    np.testing.assert_allclose(twice, 2 * once, atol=1e-4 * np.abs(once).max())
