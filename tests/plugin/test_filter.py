"""Narrow reconstruction filters are sampled: all passes count the same, at places that fall as the filter says.

How wide ones weigh samples is in ``test_samples.py``.
"""

from math import erf
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.plugin.filter import Filter
from mi_dogsplat.plugin.samples import samples
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from mi_dogsplat.scene.splats import Splats
from read_together import read_gradients
from splat_scenes import (
    assert_gradients_equal,
    differences,
    dog_dict,
    random_splats,
    rounded,
    scene_of,
    seen_at,
    square_camera,
)

BLENDERS: dict[str, Any] = {"type": "gaussian", "stddev": 0.21}  # its filter of 1.5 pixels
HALF_TENT: dict[str, Any] = {"type": "tent", "radius": 0.5}  # which Mitsuba says to be a box
MODEL = rounded(random_splats(60, seed=1))
CAMERA = square_camera()


def filter_of(rfilter: dict[str, Any], **film) -> Filter:
    return Filter(mi.load_dict({"type": "hdrfilm", "rfilter": rfilter, **film}))


@pytest.mark.parametrize(
    ("rfilter", "sampled"),
    [
        ({"type": "box"}, True),
        (HALF_TENT, True),
        (BLENDERS, True),
        ({"type": "gaussian", "stddev": 0.28}, True),
        ({"type": "gaussian", "stddev": 0.29}, False),  # from 1 / (2 sqrt(pi)) = .282 on
        ({"type": "gaussian"}, False),
        ({"type": "tent"}, False),
        ({"type": "catmullrom"}, False),
        ({"type": "lanczos"}, False),
    ],
)
def test_filters_no_wider_than_a_pixel_are_sampled(rfilter, sampled):
    assert filter_of(rfilter).sampled == sampled
    assert (filter_of(rfilter, sample_border=True).border > 0) == (not sampled)


def test_places_fall_as_the_filter_says():
    """Its own distribution function makes them even in the unit square, as samples of a box are."""
    stddev, count = 0.2, 1024
    passes = filter_of({"type": "gaussian", "stddev": stddev}).places(samples(count, seed=2))
    at = np.array([(s.x, s.y) for s in passes])
    np.testing.assert_allclose(at.mean(0), 0.5, atol=1e-12)
    assert at.min() < 0.5 - 3 * stddev and at.max() > 0.5 + 3 * stddev
    even = np.vectorize(lambda d: (1 + erf(d / stddev / np.sqrt(2))) / 2)(at - 0.5)
    cells = np.histogram2d(*even.T, bins=8, range=[[0, 1], [0, 1]])[0]
    assert cells.sum() == count and abs(cells - count / 64).max() <= 4  # 16 in each; 4 is one deviation of random ones


def test_places_of_a_box_and_of_wide_filters_stay():
    passes = samples(16, seed=3)
    for rfilter in ({"type": "gaussian"}, {"type": "lanczos"}):
        assert filter_of(rfilter).places(passes) == passes
    at, before = (np.array([(s.x, s.y) for s in some]) for some in (filter_of({"type": "box"}).places(passes), passes))
    np.testing.assert_allclose(at, before, atol=1e-6)


@pytest.mark.parametrize(("rfilter", "extent"), [(BLENDERS, 0.84), (HALF_TENT, 0.5)])
def test_samples_approach_the_image_convolved_with_the_filter(rfilter, extent):
    d = extent * ((np.arange(12) + 0.5) / 6 - 1)
    if rfilter is HALF_TENT:
        kernel = 1 - abs(d) / extent
    else:
        kernel = np.exp(-(d**2) / (2 * 0.21**2)) - np.exp(-8)
    shares = np.outer(kernel, kernel) / kernel.sum() ** 2
    expected = sum(
        share * seen_at(MODEL, CAMERA, 0.5 + x, 0.5 + y)
        for row, y in zip(shares, d, strict=True)
        for share, x in zip(row, d, strict=True)
    )
    scene = scene_of(MODEL, CAMERA, film={"rfilter": rfilter, "pixel_format": "rgba"}, srgb_primitives=False)
    errors = [np.abs(np.array(mi.render(scene, spp=n)) - expected).mean() for n in (1, 4, 16, 64)]
    assert all(error < share * errors[0] for error, share in zip(errors[1:], (0.7, 0.5, 0.2), strict=True)), errors


def test_a_crop_window_is_cut_out_of_the_image_with_its_border():
    crop = {"crop_offset_x": 7, "crop_offset_y": 5, "crop_width": 20, "crop_height": 11}
    whole = mi.render(scene_of(MODEL, CAMERA, film={"rfilter": BLENDERS}), spp=4)
    for sample_border in (False, True):
        film = {"rfilter": BLENDERS, "sample_border": sample_border, **crop}
        part = mi.render(scene_of(MODEL, CAMERA, film=film), spp=4)
        np.testing.assert_allclose(np.array(part), np.array(whole)[5:16, 7:27], atol=1e-5)


@pytest.mark.slow
def test_even_random_numbers_stay_even():
    """A floor in the light of a sky and a sun: with a box or Blender's filter there is nearly no noise left."""

    def noise(rfilter: dict[str, Any]) -> float:
        up = mi.ScalarTransform4f()
        to_world = up.look_at([0, 3, 0], [0, 0, 4], [0, 1, 0])
        film = {"type": "hdrfilm", "width": 32, "height": 12, "rfilter": rfilter}
        scene: Any = {
            "type": "scene",
            "integrator": {"type": "dogpath"},
            "floor": {"type": "rectangle", "to_world": up.rotate([1, 0, 0], -90).scale(50)},
            "sky": {"type": "constant", "radiance": 0.4},
            "sun": {"type": "directional", "direction": [0.3, -1, 0.2], "irradiance": 2.0},
            "sensor": {"type": "perspective", "to_world": to_world, "fov": 20, "film": film},
            "splats": dog_dict(MODEL, to_world=up.translate([0, 100, 0])),
        }
        image = np.array(mi.render(mi.load_dict(scene), spp=64))
        return float(image.std() / image.mean())

    box, blenders, mitsubas = (noise(rfilter) for rfilter in ({"type": "box"}, BLENDERS, {"type": "gaussian"}))
    assert max(box, blenders) < 0.005 < 0.01 < mitsubas, (box, blenders, mitsubas)


# Derivatives

SMALL_CAMERA = square_camera(16, 12, f=14.0)
SMALL = rounded(random_splats(7, seed=4, degree=1))
COUNT, SEED = 3, 5


def test_derivatives_are_those_of_the_mean_over_the_places():
    adjoint = np.random.default_rng(0).normal(size=(12, 16, 4)).astype(np.float32)
    places = [(s.x, s.y) for s in filter_of(BLENDERS).places(samples(COUNT, SEED))]

    def loss(splats: Splats) -> float:
        return float(np.sum(adjoint * np.mean([seen_at(splats, SMALL_CAMERA, x, y) for x, y in places], 0)))

    film = {"pixel_format": "rgba", "rfilter": BLENDERS}
    scene = scene_of(SMALL, SMALL_CAMERA, film=film, srgb_primitives=False)
    params: Any = mi.traverse(scene)
    integrator: Any = scene.integrator()
    for name in RAW_PARAMETERS:
        dr.enable_grad(params[f"splats.{name}"])
    params.update()
    integrator.render_backward(scene, params, mi.TensorXf(adjoint), spp=COUNT, seed=SEED)
    got = read_gradients(params, RAW_PARAMETERS, "splats.")
    assert_gradients_equal(got, differences(SMALL, loss, eps=1e-7))
