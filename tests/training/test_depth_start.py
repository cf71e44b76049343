"""Points of depth maps, at which a training starts."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.datasets.dataset import Dataset, View
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.support.srgb import linear_to_srgb
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.depth_start import with_depth_points
from mi_dogsplat.training.resolve import start_of
from PIL import Image


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
    found = with_depth_points(config, data)
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
    found = with_depth_points(config, dataclasses.replace(data, points=own, point_colors=red))
    np.testing.assert_array_equal(found.points[:2], own)
    np.testing.assert_array_equal(found.point_colors[:2], red)
    spacing = 3 / 30
    assert 470 < len(found.points) < 482 and np.linalg.norm(found.points[2:] - own[0], axis=1).min() > 0.99 * spacing
    again = with_depth_points(config, found)
    np.testing.assert_array_equal(again.points, found.points)


def test_a_model_and_a_training_without_depth_maps_start_as_they_do(tmp_path):
    data = two_views(tmp_path)
    for config in TrainConfig(str(tmp_path)), TrainConfig(str(tmp_path), depths=str(tmp_path), model="model.ply"):
        assert with_depth_points(config, data) is data


def test_depths_of_what_is_masked_or_transparent_are_no_points(tmp_path):
    data = two_views(tmp_path)
    (tmp_path / "masks").mkdir()
    mask = np.full((20, 24), 255, np.uint8)
    mask[:, 8:] = 0
    Image.fromarray(mask).save(tmp_path / "masks" / "0.png")
    config = TrainConfig(str(tmp_path), depths=str(tmp_path), masks=str(tmp_path / "masks"), preset="3dgs")
    assert len(with_depth_points(config, data).points) == 20 * 8
    alpha = np.zeros((20, 24, 1), np.float32)
    alpha[:5] = 1
    views = [dataclasses.replace(view, stored=np.concatenate([view.image, alpha], axis=-1)) for view in data.train]
    seen_through = dataclasses.replace(data, train=views, has_alpha=True)
    assert len(with_depth_points(dataclasses.replace(config, masks=None), seen_through).points) == 5 * 24
