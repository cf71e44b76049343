"""Which pixels of photographs give colours, and which colours these are."""

import numpy as np
import tiny_data
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.meshing.photograph_colors import photograph_colors
from mi_dogsplat.scene.appearance import Appearance, device_of, photographed, radii_squared
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.support.srgb import displayed

CAMERA = tiny_data.cameras(1, 24, 16)[0]
NOTHING = np.zeros((16, 24, 3))  # what the model shows
PHOTOGRAPH = np.random.default_rng(0).uniform(0.1, 0.9, (16, 24, 3)).astype(np.float32)


def test_transparent_and_masked_pixels_give_no_colour(tmp_path):
    alpha = np.ones((16, 24, 1), np.float32)
    alpha[:, :4] = 0.25
    alpha[:, 4:8] = 0.75
    clear = View("clear", CAMERA, np.concatenate([PHOTOGRAPH * alpha, alpha], axis=2))
    write_png(tmp_path / "masked.png", np.where(np.arange(24) < 12, 0.0, 1.0) * np.ones((16, 1)))
    masked = View("masked", CAMERA, PHOTOGRAPH)
    colors = photograph_colors([clear, masked], DrawnAs(), Masks(tmp_path, [clear, masked]))
    np.testing.assert_allclose(colors(0, NOTHING)[:, 4:], PHOTOGRAPH[:, 4:], rtol=1e-6)
    assert np.isnan(colors(0, NOTHING)[:, :4]).all()
    np.testing.assert_array_equal(colors(1, NOTHING)[:, 12:], PHOTOGRAPH[:, 12:])
    assert np.isnan(colors(1, NOTHING)[:, :12]).all()


def test_what_a_camera_did_to_a_photograph_is_taken_out_and_the_model_says_what_was_too_bright_for_it():
    gains = np.array([[1.5, 1.4, 1.6], [-1, -1.2, -0.9]])
    learned = Appearance(["bright", "dark"], [device_of(CAMERA)], gains, np.array([[-0.4, -0.3]]))
    r_sq = radii_squared(CAMERA)
    taken = [photographed(PHOTOGRAPH, r_sq, learned.numbers(CAMERA, name)) for name in learned.names]
    assert 0.05 < (taken[0] > 1).mean() < 0.95 and np.abs(taken[1] - PHOTOGRAPH).max() > 0.2
    shown = zip(("bright", "dark", "unknown"), (*taken, PHOTOGRAPH), strict=True)
    views = [View(name, CAMERA, np.clip(image, 0, 1).astype(np.float32)) for name, image in shown]
    colors = photograph_colors(views, DrawnAs(), appearance=learned)
    for k in (0, 1):
        np.testing.assert_allclose(colors(k, PHOTOGRAPH), PHOTOGRAPH, atol=1e-5)
    lost = taken[0] >= 1
    assert (colors(0, NOTHING)[lost] < PHOTOGRAPH[lost]).mean() > 0.9
    vignetted = photographed(PHOTOGRAPH, r_sq, -learned.numbers(CAMERA))  # of an image that the run did not know
    np.testing.assert_allclose(colors(2, NOTHING), np.clip(vignetted, 0, 1), rtol=1e-6)


def test_radiance_is_shown_as_the_model_is_or_else_as_the_photographs_are():
    view = View("light", CAMERA, 5 * PHOTOGRAPH, white=2.0)
    as_model = photograph_colors([view], DrawnAs(linear=True, white=8.0))(0, NOTHING)
    np.testing.assert_array_equal(as_model, displayed(5 * PHOTOGRAPH, 8.0))
    np.testing.assert_array_equal(photograph_colors([view], DrawnAs())(0, NOTHING), displayed(5 * PHOTOGRAPH, 2.0))
