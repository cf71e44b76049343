"""Names of views that share an output file are refused as the data are read, before hours of training."""

import json

import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import PICTURE_ENDS, require_unique_names, view_name
from mi_dogsplat.support.errors import DataError


@pytest.mark.parametrize("end", PICTURE_ENDS)
@pytest.mark.parametrize("order", [1, -1])
def test_two_views_whose_pictures_would_have_the_same_name_are_one_line(tmp_path, end, order):
    line = f'of the views "a" and "a{end}" pictures would have the same name, a{end}.png; rename one of the images'
    with pytest.raises(DataError, match=line):
        require_unique_names(tmp_path, ["b", "a", f"a{end}"][::order])


def test_names_that_end_so_and_meet_no_other_are_as_good_as_any(tmp_path):
    require_unique_names(tmp_path, ["a_gt", "b_error", "a_dogs", "_gt", "c", "C_gt", "gt", "c_plain_gt_2"])


def test_only_the_folders_of_images_of_one_size_are_no_part_of_a_name():
    files = ("images/0.png", "images_4/0.png", "images_left/0.png", "images_right/0.png", "left/images/0.png")
    assert [view_name(file) for file in files] == ["0", "0", "images_left_0", "images_right_0", "left_images_0"]


def test_names_of_pictures_fit_into_a_folder(tmp_path):
    longest = 255 - len("_plain_error.png")
    require_unique_names(tmp_path, ["a" * longest, "é" * (longest // 2)])
    for name in ("a" * (longest + 1), "é" * (longest // 2 + 1)):
        with pytest.raises(DataError, match=r"a name of 240 bytes, too long for those of its pictures; .* to 239"):
            require_unique_names(tmp_path, ["b", name])


def test_a_data_set_is_refused_as_it_is_read(data, tmp_path):
    (tmp_path / "images").mkdir()
    content = json.loads((data / "transforms.json").read_text())
    for frame, name in zip(content["frames"], ("a", "a_gt", *"cdefgh"), strict=True):
        (tmp_path / "images" / f"{name}.png").write_bytes((data / frame["file_path"]).read_bytes())
        frame["file_path"] = f"images/{name}.png"
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match='"a" and "a_gt"'):
        load_dataset(tmp_path)
