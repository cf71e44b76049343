"""Small trainings on photographs that are changed, and their masks."""

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import tiny_data
from mi_dogsplat.datasets import Dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer

SHAPE = tiny_data.HEIGHT, tiny_data.WIDTH
PIXELS = tiny_data.WIDTH * tiny_data.HEIGHT


def config_of(**settings) -> TrainConfig:
    usual: dict[str, Any] = {"data": "", "preset": "3dgs", "steps": 60, "sh_degree": 0, "max_primitives": 100}
    return TrainConfig(**(usual | settings))


def planes_of(image: np.ndarray) -> list:
    return [mi.Float(np.ascontiguousarray(image[..., c]).ravel()) for c in range(3)]


def image_of(planes: list) -> np.ndarray:
    return np.stack([plane.numpy() for plane in planes], -1).reshape(*SHAPE, 3)


def trained(dataset: Dataset, **settings) -> Trainer:
    trainer = Trainer(config_of(**settings), dataset)
    for _ in range(trainer.config.steps):
        trainer.step()
    return trainer


def changed(dataset: Dataset, change) -> Dataset:
    """The data set with other training images: ``change(number, image)``."""
    train = [View(v.name, v.camera, change(k, v.image).astype(np.float32)) for k, v in enumerate(dataset.train)]
    return Dataset(dataset.path, train, dataset.test, dataset.points, dataset.point_colors, dataset.has_alpha)


def write_masks(folder: Path, dataset: Dataset, used: np.ndarray) -> Path:
    for view in dataset.views:
        write_png(folder / f"{view.name}.png", used.astype(np.float32))
    return folder


def left_half() -> np.ndarray:
    used = np.ones(SHAPE)
    used[:, : SHAPE[1] // 2] = 0
    return used
