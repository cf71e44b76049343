"""Images that a rig took at one moment are for training or for testing, never some for this and some for that."""

import json
from pathlib import Path

import pycolmap
import pytest
from dataset_folders import error_of, write_images
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.colmap_files import read_frames
from mi_dogsplat.datasets.dataset import every_eighth
from mi_dogsplat.datasets.refined import write_refined


@pytest.fixture
def rig(tmp_path) -> Path:
    """Nine moments of a rig of three cameras."""
    options = pycolmap.SyntheticDatasetOptions()
    options.camera_width, options.camera_height, options.camera_params = 24, 16, [20.0, 12.0, 8.0, 0.0]
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = 1, 3, 9, 20
    model = pycolmap.synthesize_dataset(options)
    folder = tmp_path / "data" / "sparse" / "0"
    folder.mkdir(parents=True)
    model.write_binary(folder)
    write_images(tmp_path / "data" / "images", [image.name for image in model.images.values()], (24, 16))
    return tmp_path / "data"


def model_of(data: Path, text: bool = False) -> pycolmap.Reconstruction:
    """What COLMAP reads there; the files are text afterwards, where that is asked for."""
    folder = data / "sparse" / "0"
    model = pycolmap.Reconstruction(folder)
    if text:
        for file in folder.iterdir():
            file.unlink()
        model.write_text(folder)
    return model


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
@pytest.mark.parametrize("split, n_train, n_test", [("test", 21, 6), ("validation", 18, 3)])
def test_views_of_one_moment_are_on_one_side_of_a_split(rig, text, split, n_train, n_test):
    model, dataset = model_of(rig, text), load_dataset(rig, split=split)
    moments = {Path(image.name).stem: image.frame_id for image in model.images.values()}
    trained, measured = ({moments[view.name] for view in views} for views in (dataset.train, dataset.test))
    assert dataset.rig_frames == {view.name: moments[view.name] for view in dataset.views}
    assert not trained & measured and (len(dataset.train), len(dataset.test)) == (n_train, n_test)


@pytest.mark.parametrize("suffix", ["bin", "txt"])
def test_frames_are_those_that_colmap_reads(rig, suffix):
    model = model_of(rig, text=suffix == "txt")
    expected = {image.image_id: image.frame_id for image in model.images.values()}
    assert read_frames(rig / "sparse" / "0" / f"frames.{suffix}") == expected


def test_models_without_frames_are_split_by_images(rig):
    (rig / "sparse" / "0" / "frames.bin").unlink()
    dataset = load_dataset(rig)
    assert [view.name for view in dataset.test] == sorted(view.name for view in dataset.views)[::8]


@pytest.mark.parametrize("split", ["test", "validation"])
@pytest.mark.parametrize("listed", [True, False], ids=["test views named", "none named"])
def test_a_refined_data_set_keeps_the_split(rig, tmp_path, listed, split):
    given = load_dataset(rig, split=split)
    write_refined(tmp_path / "refined", given, rig, {})
    file = tmp_path / "refined" / "transforms.json"
    content = json.loads(file.read_text())
    if not listed:
        file.write_text(json.dumps({key: content[key] for key in content if not key.endswith("_filenames")}))
    refined = load_dataset(file.parent, split=split)
    assert [view.name for view in refined.test] == [view.name for view in given.test]
    assert [view.name for view in refined.train] == [view.name for view in given.train]


@pytest.mark.parametrize("number", [1.5, "1", True, [1]])
def test_a_frame_of_a_rig_has_a_whole_number(rig, tmp_path, number):
    write_refined(tmp_path / "refined", load_dataset(rig), rig, {})
    file = tmp_path / "refined" / "transforms.json"
    content = json.loads(file.read_text())
    content["frames"][3]["rig_frame"] = number
    file.write_text(json.dumps(content))
    error = error_of(file.parent)
    assert error.startswith(f"{file}: frame ") and f'"rig_frame" is {json.dumps(number)}; make it' in error


def test_one_moment_alone_is_trained_on():
    assert every_eighth(list("abc"), dict.fromkeys("abc", 5)) == (list("abc"), [])
    assert every_eighth(list("abcd"), dict.fromkeys("abc", 5)) == (["d"], list("abc"))


@pytest.mark.parametrize("suffix, damage, said", [
    ("bin", lambda data: data[:-3], "ends early"),
    ("bin", lambda data: data + b"1", "1 byte too many after the last entry"),
    ("txt", lambda data: data.replace(b" 3 CAMERA", b" 4 CAMERA"), "9 words for 4 data ids of 3"),
    ("txt", lambda data: data.replace(b" 3 CAMERA", b" three CAMERA"), "cannot be read"),
    ("txt", lambda data: b"7 1\n", "line 1 cannot be read"),
])  # fmt: skip
def test_damaged_frames_are_one_line(rig, suffix, damage, said):
    model_of(rig, text=suffix == "txt")
    file = rig / "sparse" / "0" / f"frames.{suffix}"
    file.write_bytes(damage(file.read_bytes()))
    error = error_of(rig)
    assert error.startswith(f"{file}: ") and said in error
