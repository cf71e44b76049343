"""What is wrong with the settings of a training shows before poses of its photographs are looked for."""

from pathlib import Path

import numpy as np
import pytest
from command_line import assert_one_line, run
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.report.run_folder import CONFIG
from mi_dogsplat.runs.checkpoint import CHECKPOINT
from mi_dogsplat.runs.unposed import check_unposed
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from PIL import Image


@pytest.fixture
def photos(tmp_path) -> Path:
    """Three photographs, as wide as panoramas, and maps and masks of another capture."""
    for name in ("photos/IMG 1.jpg", "photos/IMG 2.jpg", "photos/left/3.jpg", "depths/other.png", "masks/other.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.full((8, 16), 255, np.uint8)).save(tmp_path / name)
    return tmp_path / "photos"


@pytest.mark.parametrize(
    ("flags", "line"),
    [
        (["--variant", "cuda"], '--variant: "cuda" cannot be used'),
        (["--depths", "nowhere"], "nowhere: no such folder; give a folder with a depth map per image"),
        (["--depths", "depths"], "has no depth map for any of the images; name them like the images, as IMG_1.png"),
        (["--masks", "nowhere"], "nowhere: no such folder; give a folder with a mask per image"),
        (["--scale", "IMG 1.jpg", "IMG_9.jpg", "2"], '--scale: no image "IMG_9.jpg" is there; name two of them, like'),
        (["--scale", "IMG 1.jpg:3,4+IMG_9:5,6", "IMG 2", "2"], '--scale: no image "IMG_9" is there'),
        (["--white", "2"], "--white: is for linear images; leave it out"),
    ],
)
def test_a_wrong_setting_is_one_line_before_the_search(photos, capsys, monkeypatch, flags, line):
    pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")
    monkeypatch.chdir(photos.parent)
    assert_one_line(run(capsys, "train", "photos", "-o", "run", *flags), line)
    assert not Path("run").exists()


@pytest.mark.parametrize(
    ("config", "line"),
    [
        ({"masks": "masks"}, "masks: has no mask for any of the images; name them like the images, as IMG_1.png"),
        ({"scale": ("IMG_1", "IMG_9", "2")}, '--scale: no image "IMG_9" is there; name two of them, like IMG_1'),
        (
            {"scale": ("front/IMG_1", "IMG_2", "2"), "lens": "EQUIRECTANGULAR"},
            '--scale: no image "IMG_2" is there; name two of them, like back/IMG_1.jpg, or',
        ),
    ],
)
def test_a_search_for_poses_begins_with_what_names_its_images(photos, monkeypatch, config, line):
    pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")
    monkeypatch.chdir(photos.parent)
    with pytest.raises(DataError, match=f"^{line} ?"):
        find_poses("photos", "posed", PosesConfig(**config))
    assert not Path("posed").exists()


def test_images_are_named_as_they_are_or_as_the_data_set_will_have_them(photos):
    (photos.parent / "depths" / "left").mkdir()
    (photos.parent / "depths" / "other.png").rename(photos.parent / "depths" / "left" / "3.png")
    for first, second in (("IMG 1.jpg", "IMG_2"), ("left/3.jpg:1,2+IMG_1:3,4", "left_3"), ("front/IMG_1", "IMG_2.jpg")):
        scale, depths = (first, second, "2"), str(photos.parent / "depths")
        check_unposed(TrainConfig(str(photos), scale=scale, depths=depths), photos / "run")


def test_a_run_that_was_stopped_is_told_before_poses_are_sought_in_its_folder(photos, capsys):
    (out := photos.parent / "run").mkdir()
    for name in (CONFIG, CHECKPOINT):
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text("{}")
    assert_one_line(run(capsys, "train", photos, "-o", out), f"{out}: holds a training that was stopped; add --resume")
    assert not (out / "posed").exists()
    check_unposed(TrainConfig(str(photos)), out, resume=True)


def test_an_exposure_is_not_learned_of_linear_images(tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.exr").touch()
    check_unposed(TrainConfig(str(tmp_path), white=2.0), tmp_path / "run")
    with pytest.raises(DataError, match="^--appearance: is for photographs, not for linear images; leave it out$"):
        check_unposed(TrainConfig(str(tmp_path), appearance=True), tmp_path / "run")


def test_of_a_video_only_the_folder_of_depth_maps_is_known(tmp_path):
    (tmp_path / "walk.mp4").touch()
    data, out = str(tmp_path / "walk.mp4"), tmp_path / "run"
    check_unposed(TrainConfig(data, scale=("frame_000001", "frame_000009", "2"), depths=str(tmp_path)), out)
    with pytest.raises(DataError, match="nowhere: no such folder; give a folder with a depth map per image"):
        check_unposed(TrainConfig(data, depths="nowhere"), out)
