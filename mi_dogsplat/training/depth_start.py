"""Points of depth maps, at which a training starts beside those of the data set."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..datasets import Dataset
from ..datasets.depth_points import depth_points, far_from
from ..datasets.depths import Depths
from ..datasets.masks import Masks
from ..scene.cameras import Camera
from ..support.srgb import displayed
from .config import TrainConfig

OPAQUE = 0.5  # alpha of a pixel whose depth is that of the scene


def with_depth_points(config: TrainConfig, dataset: Dataset) -> Dataset:
    """The data set with the points of its depth maps too, where these are given, except beside its own. Raises
    ``DataError``."""
    if config.depths is None or config.model is not None:
        return dataset
    points, colors = depth_points(_views(config, config.depths, dataset), len(dataset.train), config.seed)
    new = far_from(points, dataset.points)
    return replace(
        dataset,
        points=np.concatenate([dataset.points, points[new]]),
        point_colors=np.concatenate([dataset.point_colors, colors[new]]),
    )


def _views(config: TrainConfig, folder: str, dataset: Dataset) -> Iterator[tuple[Camera, np.ndarray, np.ndarray]]:
    """What ``depth_points`` takes, of the training views with a depth map; depths of what is masked or transparent are
    unknown."""
    depths = Depths(folder, dataset)
    masks = Masks(config.masks, dataset.train) if config.masks is not None else None
    for view in dataset.train:
        depth = depths.of(view)
        if depth is None:
            continue
        image, mask = view.image, masks.of(view) if masks else None
        shown = displayed(image[..., :3], dataset.white) if dataset.white else image[..., :3]
        if mask is not None:
            depth = depth * mask
        if dataset.has_alpha:
            depth = np.where(image[..., 3] > OPAQUE, depth, np.float32(0))
        yield view.camera, depth, shown
