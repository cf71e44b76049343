"""What a render is compared with where the sensor of a photograph was full: it may be brighter, but not darker."""

from pathlib import Path

import numpy as np
import pytest
from hdr_data import write_saturated_data
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.support.srgb import linear_to_srgb_log
from mi_dogsplat.training.images.loss import PhotometricLoss
from mi_dogsplat.training.images.photographs import Photographs
from photographs import image_of, planes_of


@pytest.fixture(scope="module")
def opaque(tmp_path_factory) -> Path:
    return write_saturated_data(tmp_path_factory.mktemp("full") / "data")


@pytest.fixture(scope="module")
def clear(tmp_path_factory) -> Path:
    return write_saturated_data(tmp_path_factory.mktemp("full") / "data", alpha=True)


def as_seen(image: np.ndarray, white: float) -> np.ndarray:
    """What the loss sees of radiance, in float64."""
    return linear_to_srgb_log(np.asarray(image[..., :3], np.float64) / white)


def in_planes(photographs: Photographs, radiance: np.ndarray) -> list:
    """A render [H, W, 3] in the unit of the images, as the trainer has it."""
    return planes_of((radiance / photographs.white).astype(np.float32))


def loss_of(photographs: Photographs, radiance: np.ndarray, view: int = 0) -> float:
    return float(photographs.compare(in_planes(photographs, radiance), view, 0)[1][0])


def test_a_render_that_is_brighter_agrees_and_one_that_is_darker_does_not(opaque):
    dataset = load_dataset(opaque)
    view, photographs = dataset.train[0], Photographs(dataset, 0.0)
    full = view.recording.saturated
    assert full is not None and 0 < full.mean() < 0.9
    full = full[..., None]
    planes = in_planes(photographs, np.where(full, 1.7 * view.image + 0.1, view.image))
    _, loss, gradient = photographs.compare(planes, 0, 0)
    assert float(loss[0]) == pytest.approx(0, abs=1e-6) and not (image_of(gradient) * full).any()
    assert float(photographs.l1(planes, 0)[0]) == pytest.approx(0, abs=1e-6)
    darker = in_planes(photographs, np.where(full, 0.5 * view.image, view.image))
    _, loss, gradient = photographs.compare(darker, 0, 0)
    assert float(loss[0]) > 1e-3 and (image_of(gradient) * full).sum() < 0
    assert float(photographs.l1(darker, 0)[0]) > 1e-3
    assert loss_of(photographs, np.where(full, view.image, 1.3 * view.image)) > 1e-3


@pytest.mark.parametrize("how", ["kept", "not kept", "masked", "random"])
def test_loss_and_gradient_are_those_of_a_render_that_is_cut_off_there(opaque, clear, how, tmp_path):
    """By the loss of what NumPy cuts off, and by its differences."""
    dataset = load_dataset(clear if how == "random" else opaque)
    view, white = dataset.train[0], dataset.white or 1.0
    height, width, _ = view.image.shape
    mask = np.ones((height, width, 1))
    if how == "masked":
        mask[:, : width // 2] = 0
        for of in dataset.train:
            write_png(tmp_path / f"{of.name}.png", mask[..., 0])
    masks = str(tmp_path) if how == "masked" else None
    photographs = Photographs(dataset, 0.0, random=how == "random", masks=masks, keep_targets=how != "not kept")
    photographs.choose_background(np.random.default_rng(0))
    behind = np.array([float(level[0]) for level in photographs.color or [[0.0]] * 3])
    opacity = view.image[..., 3:] if dataset.has_alpha else 1
    truth = as_seen(view.image[..., :3] + (1 - opacity) * behind * white, white)
    full = view.recording.saturated
    assert full is not None

    def expected(radiance: np.ndarray) -> float:
        seen = as_seen(radiance, white)
        seen = np.where(full[..., None], np.minimum(seen, truth), seen) * mask
        loss = PhotometricLoss(most=np.inf)
        target = loss.target((truth * mask).astype(np.float32))
        return float(loss.value_and_gradient(planes_of(seen.astype(np.float32)), target)[2][0])

    rng = np.random.default_rng(1)
    render = rng.uniform(0.02, 3, (*full.shape, 3))
    _, value, planes = photographs.compare(in_planes(photographs, render), 0, 0)
    gradient = image_of(planes) / white
    assert float(value[0]) == pytest.approx(expected(render), rel=1e-5)
    direction = np.sign(gradient) * render * rng.uniform(0.5, 1.5, render.shape)  # so that the loss changes clearly
    h = 1e-3
    difference = (expected(render + h * direction) - expected(render - h * direction)) / (2 * h)
    assert float((gradient * direction).sum()) == pytest.approx(difference, rel=0.01)


def test_views_on_disk_and_small_ones_are_compared_alike(opaque):
    held = Photographs(load_dataset(opaque), 0.0)
    read = Photographs(load_dataset(opaque, on_disk=True), 0.0, on_disk=True)
    render = np.random.default_rng(1).uniform(0.02, 3, held.views[0].image.shape)
    assert loss_of(held, render) == pytest.approx(loss_of(read, render), rel=1e-6)
    held.shrink(2)
    small, full = held.views[0].image, held.views[0].recording.saturated
    assert full is not None and full.any()
    assert loss_of(held, np.where(full[..., None], 9 * small, small)) == pytest.approx(0, abs=1e-6)
