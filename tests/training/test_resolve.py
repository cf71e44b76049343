"""What the settings make of a recipe."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.datasets.dataset import Dataset, View
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.support.srgb import linear_to_srgb
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.resolve import recipe_of_run, start_of, with_points


@pytest.mark.parametrize("settings", [{}, {"format": "sog", "target": "20kB"}, {"model": "model.ply"}])
def test_preconditioned_steps_go_with_each_format_and_with_a_model_that_exists(settings):
    config = TrainConfig("data", steps=6000, preconditioned=True, **settings)
    found, without = recipe_of_run(config, None), recipe_of_run(TrainConfig("data", steps=6000, **settings), None)
    factor = 6000 / (15_000 if "model" in settings else 30_000)
    assert found.preconditioning and not without.preconditioning
    assert found.preconditioning.start == 18_500 * factor
    assert bool(found.dog) == bool(without.dog) == ("format" not in settings)


@pytest.mark.parametrize("name", ["mini_splatting", "mcmc", "3dgs_equal"])
def test_methods_of_a_comparison_have_them_too(name):
    assert recipe_of_run(TrainConfig("data", preconditioned=True), METHODS[name].recipe).preconditioning
    assert not recipe_of_run(TrainConfig("data"), METHODS[name].recipe).preconditioning


@pytest.mark.parametrize("name", ["ours_preconditioned", "ours_second_cuts", "ours_curvatures", "ours_shifts"])
def test_a_preset_that_has_them_keeps_its_own(name):
    recipe = RECIPES[name]
    ours = [recipe_of_run(TrainConfig("data", preconditioned=p), recipe).preconditioning for p in (False, True)]
    assert ours[0] == ours[1] == recipe.preconditioning


def test_a_shorter_growth_goes_with_each_preset_and_with_preconditioned_steps():
    config = TrainConfig("data", preset="ours", steps=3000, growth=0.4, preconditioned=True, format="sog")
    found, usual = recipe_of_run(config, None), recipe_of_run(dataclasses.replace(config, growth=None), None)
    assert found.pruning and usual.pruning and found.preconditioning and usual.preconditioning and found.refinement
    assert (usual.densification.stop, usual.pruning.start) == (1500, 1500)
    assert (found.densification.stop, found.pruning.start, found.refinement.start) == (1200, 1200, 1200)
    assert usual.preconditioning.start - found.preconditioning.start == 300


def two_views(folder: Path, white: float | None = None) -> Dataset:
    """Of a wall at z = 3 whose red grows to the right, from two places, with depth maps; the second has none."""
    image = np.zeros((20, 24, 3), np.float32)
    image[..., 0] = np.linspace(0.1, 0.9, 24)
    cameras = [Camera(affine(np.eye(3), (x, 0, 0)), 30, 30, 12, 10, 24, 20) for x in (0, 1)]
    views = [View(f"{k}", camera, image, white=white) for k, camera in enumerate(cameras)]
    np.save(folder / "0.npy", np.full((10, 12), 3.0))
    nothing = np.zeros((0, 3), np.float32)
    return Dataset(folder, views, [], nothing, nothing, False)


@pytest.mark.parametrize("white", [None, 2.0])
def test_without_points_a_training_starts_at_the_depth_maps(tmp_path, white):
    data = two_views(tmp_path, white)
    config = TrainConfig(str(tmp_path), depths=str(tmp_path), preset="3dgs")
    found = with_points(config, data)
    assert len(found.points) == 480
    np.testing.assert_allclose(found.points[:, 2], 3, rtol=1e-6)
    column = (found.points[:, 0] / 3 * 30 + 12).astype(int)
    red = np.linspace(0.1, 0.9, 24)[column]
    np.testing.assert_allclose(found.point_colors[:, 0], linear_to_srgb(red / white) if white else red, rtol=1e-5)
    np.testing.assert_allclose(start_of(config, data).splats.means, found.points, rtol=1e-6)


def test_points_that_there_are_stay_and_depth_maps_add_others(tmp_path):
    data = two_views(tmp_path)
    config = TrainConfig(str(tmp_path), depths=str(tmp_path), preset="3dgs")
    own, red = np.array([[0, 0, 3], [9, 9, 9]], np.float32), np.array([[1, 0, 0]] * 2, np.float32)
    found = with_points(config, dataclasses.replace(data, points=own, point_colors=red))
    np.testing.assert_array_equal(found.points[:2], own)
    np.testing.assert_array_equal(found.point_colors[:2], red)
    spacing = 3 / 30
    assert 470 < len(found.points) < 482 and np.linalg.norm(found.points[2:] - own[0], axis=1).min() > 0.99 * spacing
    again = with_points(config, found)
    np.testing.assert_array_equal(again.points, found.points)


def test_a_model_and_a_training_without_depth_maps_start_as_they_do(tmp_path):
    data = two_views(tmp_path)
    for config in TrainConfig(str(tmp_path)), TrainConfig(str(tmp_path), depths=str(tmp_path), model="model.ply"):
        assert with_points(config, data) is data
