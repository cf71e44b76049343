"""A training does not know the unit of length."""

from dataclasses import replace
from pathlib import Path

import hdr_data
import numpy as np
import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import camera_extent
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.optimizer.learning_rates import LearningRates

from benchmarks.training import scene_scale

ALIKE = 0.2  # dB; seeds differ by more


@pytest.fixture(scope="module")
def config(data) -> TrainConfig:
    return TrainConfig(str(data), steps=200, sh_degree=1, max_primitives=100, target=40)


@pytest.fixture(scope="module")
def usual(config) -> float:
    return scene_scale.trained(config, load_dataset(config.data))["test_psnr"]


@pytest.mark.parametrize("scale", [0.01, 100])
def test_a_scene_in_other_units_trains_alike(config, usual, scale):
    row = scene_scale.trained(config, load_dataset(config.data), scale)
    assert row["n"] == 40 and row["n_dog"] > 30
    assert row["test_psnr"] == pytest.approx(usual, abs=ALIKE)


@pytest.mark.slow
def test_with_position_steps_in_units_of_the_world_it_does_not(config, usual, monkeypatch):
    at = LearningRates.at
    monkeypatch.setattr(LearningRates, "at", lambda self, *now: at(replace(self, extent=3.3), *now))
    dataset = load_dataset(config.data)
    assert camera_extent(dataset.train) == pytest.approx(3.3, abs=0.5)
    assert abs(scene_scale.trained(config, dataset, 0.0001)["test_psnr"] - usual) > 5 * ALIKE


def test_every_length_of_a_data_set_is_in_the_other_unit(config):
    before = load_dataset(Path(config.data))
    after = scene_scale.in_units(before, 100)
    assert camera_extent(after.train) == pytest.approx(100 * camera_extent(before.train), rel=1e-5)
    np.testing.assert_allclose(after.points, 100 * before.points)
    for view, other in zip(before.views, after.views, strict=True):
        pixels, depths = view.camera.project(before.points)
        projected, farther = other.camera.project(after.points)
        np.testing.assert_allclose(projected, pixels, atol=1e-4)
        np.testing.assert_allclose(farther, 100 * depths, rtol=1e-5)


def test_radiance_stays_radiance_and_what_is_on_disk_stays_there(tmp_path):
    before = load_dataset(hdr_data.write_hdr_data(tmp_path), on_disk=True)
    after = scene_scale.in_units(before, 100)
    assert after.white == before.white is not None
    assert all(view.n_bytes == 0 for view in after.views) and after.points.dtype == np.float32
    np.testing.assert_array_equal(after.test[0].image, before.test[0].image)
