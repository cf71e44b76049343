"""Views whose poses are off are found again from their photographs, by a model that is right."""

from dataclasses import replace

import numpy as np
import tiny_data
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.measure.align import aligned
from mi_dogsplat.measure.evaluate import Measure, evaluate_views
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.scene.camera_motions import moved_w2c

EXTENT = 3.0
MODEL = tiny_data.truth()
EXACT = tiny_data.cameras()[1]
PHOTOGRAPH = tiny_data.picture(MODEL, EXACT).color


def picture(view: View):
    return tiny_data.picture(MODEL, view.camera)


def displaced(noise: float) -> View:
    motion = np.random.default_rng(0).normal(scale=noise, size=(1, 6))
    view = View("1", EXACT, PHOTOGRAPH)
    return replace(view, camera=replace(EXACT, w2c=moved_w2c(EXACT.w2c[None], motion, EXTENT)[0]))


def distance(view: View) -> float:
    return float(np.linalg.norm(view.camera.w2c - EXACT.w2c))


def test_a_displaced_view_is_found_again():
    view = displaced(0.01)
    found = aligned(picture, view, 0.0, EXTENT)
    assert distance(found) < 0.01 * distance(view)
    assert found.name == view.name and found.image is view.image


def test_what_is_masked_has_no_say():
    view, mask = displaced(0.01), np.ones(PHOTOGRAPH.shape[:2])
    mask[:, 30:] = 0
    spoilt = View("1", view.camera, np.where(mask[..., None] > 0, PHOTOGRAPH, 0.9).astype(np.float32))
    found = aligned(picture, spoilt, 0.0, EXTENT, mask)
    assert distance(found) < 0.05 * distance(view)


def test_the_aligned_psnr_is_another_figure_beside_the_others_and_comes_when_it_is_asked_for():
    view = displaced(0.01)
    usual = evaluate_views(picture, [view], 0.0)["1"]
    measured = evaluate_views(picture, [view], 0.0, measure=Measure(align_extent=EXTENT))["1"]
    assert measured.pop("aligned_psnr") > usual["psnr"] + 10
    assert measured == usual and usual["psnr"] == psnr(picture(view).color, PHOTOGRAPH)


def test_a_view_from_where_nothing_fits_better_stays():
    view = View("1", EXACT, np.full_like(PHOTOGRAPH, 0.5))
    blank = tiny_data.picture(MODEL.select(np.zeros(0, int)), EXACT)
    assert aligned(lambda _: blank, view, 0.0, EXTENT) is view
