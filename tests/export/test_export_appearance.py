"""What ``--appearance`` has learned of photographs is no goal of an export: the model is without it."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_data
from mi_dogsplat import write_ply
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.export.export_config import ExportConfig
from mi_dogsplat.export.refine import by_data
from mi_dogsplat.export.write import export_model
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.scene.appearance import APPEARANCE, Appearance, device_of, photographed, radii_squared
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.support.pictures import write_png

MODEL = tiny_data.dog_model(0.8, 0.6)
DRAWN = DrawnAs(near_clip=0.05)


@pytest.fixture
def appearance(data) -> Appearance:
    """Of photographs that are up to two stops too dark or too bright, bluish, and dark at the corners."""
    views = load_dataset(data).train
    gains = np.linspace(-2, 2, len(views))[:, None] + (0.1, 0, -0.1)
    return Appearance([v.name for v in views], [device_of(views[0].camera)], gains, np.array([[-0.3, -0.2]]))


def altered(dataset: Dataset, appearance: Appearance) -> Dataset:
    """Photographs of the model, taken with that."""
    train = []
    for view in dataset.train:
        shown = tiny_data.picture(MODEL, view.camera).color
        numbers = appearance.numbers(view.camera, view.name)
        taken = np.clip(photographed(shown, radii_squared(view.camera), numbers), 0, 1)
        train.append(View(view.name, view.camera, (np.round(taken * 255) / 255).astype(np.float32)))
    return replace(dataset, train=train)


def test_the_goal_is_the_model_where_nothing_else_differs_also_where_the_photograph_is_white(data, appearance):
    dataset = altered(load_dataset(data), appearance)
    goal = by_data(MODEL, dataset, 100, PictureOptions(), DRAWN, appearance=appearance)
    without = by_data(MODEL, dataset, 100, PictureOptions(), DRAWN)
    white = 0
    for view, picture, plain in zip(dataset.train, goal.pictures, without.pictures, strict=True):
        own = tiny_data.picture(MODEL, view.camera).color
        white += np.sum((view.image == 1) & (own < 0.9))
        assert psnr(picture, own) > 38 and psnr(picture, own) > psnr(plain, own)
    assert white > 100
    assert min(psnr(a, b.image) for a, b in zip(without.pictures, dataset.train, strict=True)) > 80


def test_an_export_takes_what_its_run_has_learned(data, appearance, tmp_path):
    folder = shutil.copytree(data, tmp_path / "taken")
    for view in altered(load_dataset(data), appearance).train:
        write_png(folder / "images" / f"{view.name}.png", view.image)
    write_ply(tmp_path / "model.ply", MODEL)

    def loss(out: Path) -> float:
        told = export_model(tmp_path / "model.ply", out, ExportConfig(refine=30, views=1), folder)
        return told.losses[-1].of_model or 0.0

    unknown = loss(tmp_path / "a.ply")
    appearance.write(tmp_path / APPEARANCE)
    assert loss(tmp_path / "b.ply") > unknown + 1
