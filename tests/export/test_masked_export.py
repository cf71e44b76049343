"""What masks of the photographs hide is neither refined towards nor measured in an export."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.export.export_config import ExportConfig
from mi_dogsplat.export.refine import by_data
from mi_dogsplat.export.write import export_model
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.runs.inputs import note_inputs
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.training.config import TrainConfig
from photographs import left_half, write_masks
from rendered_files import read_png

MODEL = tiny_data.dog_model(0.8, 0.6)


@pytest.fixture
def spoiled(data, tmp_path) -> Path:
    """The data with a white wall where masks are black; these lie in ``masks``, beside that of one view less."""
    shutil.copytree(data, tmp_path / "spoiled")
    write_masks(tmp_path / "masks", load_dataset(data), left_half())
    for image in (tmp_path / "spoiled" / "images").iterdir():
        pixels = read_png(image) / 255
        write_png(image, np.where(left_half()[..., None] > 0, pixels, 1))
    write_ply(tmp_path / "model.ply", MODEL)
    return tmp_path / "spoiled"


def exported(folder: Path, data: Path, masks: bool = True):
    """(what was told, the bytes of the file)"""
    config = ExportConfig(refine=3, masks=str(folder / "masks") if masks else None)
    told = export_model(folder / "model.ply", folder / "out.ply", config, data)
    return told, (folder / "out.ply").read_bytes()


def test_a_model_is_refined_and_measured_as_if_nothing_were_behind_the_masks(data, spoiled, tmp_path):
    (told, file), (clean, of_clean) = exported(tmp_path, spoiled), exported(tmp_path, data)
    assert file == of_clean and not told.left_out
    assert [loss.of_photographs for loss in told.losses] == [loss.of_photographs for loss in clean.losses]
    unmasked, spoilt = exported(tmp_path, spoiled, masks=False)
    assert spoilt != file and (unmasked.losses[0].of_photographs or 0) < (told.losses[0].of_photographs or 0) - 5


def test_where_masks_are_black_the_goal_is_the_model_itself(spoiled, tmp_path):
    dataset, drawn = load_dataset(spoiled), DrawnAs(near_clip=0.05)
    (tmp_path / "masks" / f"{dataset.train[1].name}.png").unlink()
    masks = Masks(tmp_path / "masks", dataset.views)
    goal = by_data(MODEL, dataset, 100, PictureOptions(), drawn, masks)
    for k, (view, picture) in enumerate(zip(dataset.train, goal.pictures, strict=True)):
        own = tiny_data.picture(MODEL, view.camera).color
        expected = view.image if k == 1 else np.where(left_half()[..., None] > 0, view.image, own)
        np.testing.assert_allclose(picture, expected, atol=1e-6)


def test_views_whose_masks_are_all_black_are_not_measured(spoiled, tmp_path):
    for view in load_dataset(spoiled).test:
        write_png(tmp_path / "masks" / f"{view.name}.png", np.zeros(left_half().shape))
    assert {loss.of_photographs for loss in exported(tmp_path, spoiled)[0].losses} == {None}


def test_masks_of_photographs_that_nobody_looks_at_are_refused_and_images_without_one_told(capsys, spoiled, tmp_path):
    command = ["export", tmp_path / "model.ply", "-o", tmp_path / "out.ply", "--masks", tmp_path / "masks"]
    assert_one_line(run(capsys, *command), "--masks: is for photographs, and none are used; add --data DATA")
    (tmp_path / "masks" / "1.png").unlink()
    status, told, _ = run(capsys, *command, "--data", spoiled, "--refine", 0)
    assert status == 0 and f"{tmp_path / 'masks'}: no mask for 1 of 8 images, such as 1" in told


def test_an_export_and_a_measurement_of_a_run_with_masks_tell_to_give_them(capsys, spoiled, tmp_path):
    (tmp_path / "run").mkdir()
    model, masks = tmp_path / "run" / "point_cloud.ply", tmp_path / "masks"
    write_ply(model, MODEL)
    note_inputs(TrainConfig(str(spoiled), masks=str(masks)), tmp_path / "run")
    line = f"{model} was trained with masks; what they hide counts here unless you give --masks {masks}"
    export = ["export", model, "-o", tmp_path / "out.ply", "--data", spoiled, "--refine", 0]
    for command in (export, ["eval", model, spoiled]):
        assert line in run(capsys, *command)[1].splitlines()
        assert "trained with masks" not in run(capsys, *command, "--masks", masks)[1]
    shutil.copy(model, tmp_path / "elsewhere.ply")
    assert "trained with masks" not in run(capsys, "eval", tmp_path / "elsewhere.ply", spoiled)[1]
