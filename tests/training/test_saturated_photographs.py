"""What follows for a training, and for all that compares models with photographs, where a sensor was full."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hdr_data import FULL, bright_truth, write_hdr_data, write_saturated_data
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import Dataset, Recording
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.export.refine import by_data
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.measure.evaluate import evaluate_views
from mi_dogsplat.render.picture import Picture, light_of, picture_of
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.drawing import DrawnAs, drawn_as
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.support.srgb import displayed
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.memory_budget import BOUNDS, budget
from mi_dogsplat.training.point_radiance import point_radiance


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return write_saturated_data(tmp_path_factory.mktemp("full") / "data")


def test_measures_let_a_render_be_brighter_there(data):
    """Also where a full pixel is shown as grey."""
    view = load_dataset(data).exposed(2.0).train[0]
    full = view.recording.saturated
    assert full is not None

    def measured(radiance: np.ndarray) -> dict[str, float]:
        light = radiance.astype(np.float32)
        picture = Picture(displayed(light, 2.0), np.ones(full.shape, np.float32), None, radiance=light, white=2.0)
        return evaluate_views(lambda view: picture, [view], 0.0)[view.name]

    best = measured(np.where(full[..., None], 3 * view.image, view.image))
    assert best["psnr"] == best["psnr_mu"] == 100 and best["flip"] == best["hdr_flip"] == 0
    for worse in (np.where(full[..., None], 0.5 * view.image, view.image), 1.5 * view.image):
        assert measured(worse)["psnr"] < 40 and measured(worse)["hdr_flip"] > 0.01


def test_points_have_the_radiance_of_views_that_tell_it_or_else_the_highest_bound(data):
    dataset = load_dataset(data)
    light, full = np.ones_like(dataset.train[0].image), np.ones(dataset.train[0].image.shape[:2], bool)

    def radiance(*recordings: Recording) -> np.ndarray:
        """[50, 3] of clipped points, of which what no view sees has 1."""
        views = zip(dataset.train, recordings, strict=False)
        train = [replace(view, stored=recording, white=1.0) for view, recording in views]
        some, colors = dataset.points[:50], np.ones((50, 3), np.float32)
        return point_radiance(Dataset(dataset.path, train, [], some, colors, dataset.has_alpha))

    bounds = Recording(2 * light, full), Recording(3 * light, full)
    told = radiance(*bounds, Recording(9 * light))
    assert np.isclose(told, 9).mean() > 0.5 and np.isin(told.round(3), (1, 3, 9)).all()
    assert set(radiance(*bounds).round(3).ravel()) <= {1, 2, 3} and np.isclose(radiance(*bounds), 3).mean() > 0.5


def test_a_refined_export_keeps_what_is_brighter_than_a_photograph_can_tell(data, tmp_path):
    dataset, model = load_dataset(data), bright_truth()
    drawn = DrawnAs(linear=True, white=dataset.white or 1.0)
    pictures = by_data(model, dataset, 8, PictureOptions(), drawn).pictures
    bounded = 0
    for view, picture in zip(dataset.train, pictures, strict=True):
        full = view.recording.saturated
        if full is None:
            np.testing.assert_array_equal(picture, view.image)
            continue
        bounded += 1
        assert picture[full].max() > 1.5 * FULL and (picture[full] >= view.image[full]).all()
        np.testing.assert_array_equal(picture[~full], view.image[~full])
    assert 0 < bounded < len(dataset.train)
    for view in dataset.train:
        write_png(tmp_path / f"{view.name}.png", np.zeros(view.image.shape[:2]))
    own = picture_of(model, 0.0, drawn)(dataset.train[0].camera).radiance
    masked = by_data(model, dataset, 8, PictureOptions(), drawn, Masks(tmp_path, dataset.train)).pictures
    np.testing.assert_array_equal(masked[0], own)


def test_memory_counts_the_bounds_of_views_that_have_some(data):
    dataset = load_dataset(data)
    views = [replace(view, stored=view.image) for view in dataset.train]
    full = [view for view in dataset.train if view.recording.saturated is not None]
    with_bounds, without = budget("4GB", dataset, 0), budget("4GB", replace(dataset, train=views), 0)
    assert with_bounds and without and 0 < len(full) < len(views)
    pixels = sum(view.camera.width * view.camera.height for view in full)
    marks = 1 if array_types().is_llvm else 0  # byte per pixel of a photograph, which is not on a GPU
    assert with_bounds.pictures - without.pictures == (BOUNDS + marks) * pixels


def test_a_training_finds_more_of_the_light_of_lamps_that_half_of_the_photographs_cut_off(tmp_path):
    """Of the pixels above what the sensor holds, in all views. With the truth itself as many steps find .59 of it."""
    truth = load_dataset(write_hdr_data(tmp_path / "truth"))
    lamps = {}
    for told in (True, False):
        folder, out = write_saturated_data(tmp_path / f"{told}", told=told, whole=4), tmp_path / f"run_{told}"
        train(TrainConfig(str(folder), steps=400, preset="3dgs", max_primitives=300, white=2.0), out)
        read = read_model(out / "point_cloud.ply")
        picture = picture_of(read.splats, 0.0, drawn_as(read.drawing))
        pairs = [(light_of(picture(view.camera)), view.image) for view in truth.views]
        ours, real = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in range(2))
        lamps[told] = float(ours[real > FULL].sum() / real[real > FULL].sum())
    assert lamps[True] > 0.5 and lamps[True] > 1.15 * lamps[False], lamps
