"""Names of views that share an output file are refused as the data are read, before hours of training."""

import json
import os
import subprocess
import sys
from pathlib import Path
from unicodedata import normalize

import pytest
from dataset_folders import colmap_folder, transforms_folder, write_images
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import PICTURE_ENDS, require_unique_names, view_name
from mi_dogsplat.datasets.masks import Masks
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


@pytest.mark.parametrize("kind", ["colmap", "transforms"])
def test_a_name_that_no_file_has_in_the_locale_is_one_line(tmp_path, kind):
    {"colmap": colmap_folder, "transforms": transforms_folder}[kind](tmp_path)
    old = sorted((tmp_path / "images").iterdir())[-1]
    old.rename(old.with_name("tür.png"))
    file = tmp_path / ("sparse/0/images.txt" if kind == "colmap" else "transforms.json")
    file.write_text(file.read_text().replace(old.stem, "tür"), encoding="utf-8")
    code = "import sys; from mi_dogsplat.datasets import load_dataset; print(sys.getfilesystemencoding()); "
    code += "load_dataset(sys.argv[1])"
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-c", code, tmp_path]
    done = subprocess.run(command, env=environment, cwd=Path(__file__).parents[2], capture_output=True, text=True)
    if done.stdout.strip() != "ascii":  # as of a system whose names are UTF-8 always
        pytest.skip("the names of files are not those of the locale here")
    assert "DataError" in done.stderr.splitlines()[-1] and "no file can be called" in done.stderr
    assert "set PYTHONUTF8=1" in done.stderr.splitlines()[-1]


def test_a_data_set_is_refused_as_it_is_read(data, tmp_path):
    (tmp_path / "images").mkdir()
    content = json.loads((data / "transforms.json").read_text())
    for frame, name in zip(content["frames"], ("a", "a_gt", *"cdefgh"), strict=True):
        (tmp_path / "images" / f"{name}.png").write_bytes((data / frame["file_path"]).read_bytes())
        frame["file_path"] = f"images/{name}.png"
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match='"a" and "a_gt"'):
        load_dataset(tmp_path)


@pytest.mark.parametrize(("told", "on_disk"), [("NFC", "NFD"), ("NFD", "NFC")])
@pytest.mark.parametrize("kind", ["colmap", "transforms"])
def test_letters_with_marks_are_found_however_systems_spell_them(tmp_path, kind, told, on_disk):
    """Names go from macOS, which takes letters and marks apart, to other systems, and back; those of masks do, too."""
    colmap_folder(tmp_path) if kind == "colmap" else transforms_folder(tmp_path)
    old = "img_03" if kind == "colmap" else "r_1"
    for text in [tmp_path / "sparse" / "0" / "images.txt"] if kind == "colmap" else [tmp_path / "transforms.json"]:
        content = text.read_text(encoding="utf-8").replace(old, normalize(told, "Büste"))
        text.write_text(content, encoding="utf-8")
    (tmp_path / "images" / f"{old}.png").rename(tmp_path / "images" / f"{normalize(on_disk, 'Büste')}.png")
    views = load_dataset(tmp_path).views
    (view,) = [view for view in views if normalize("NFC", view.name) == "Büste"]
    write_images(tmp_path / "masks", [f"{normalize(on_disk, 'Büste')}.png"], color=(0, 0, 0))
    mask = Masks(tmp_path / "masks", [view]).of(view)
    assert mask is not None and not mask.any()


@pytest.mark.parametrize("kind", ["colmap", "transforms"])
def test_an_extension_of_another_case_is_the_same_as_on_the_system_of_the_capture(tmp_path, kind):
    if kind == "colmap":
        colmap_folder(tmp_path)
        text, old = tmp_path / "sparse" / "0" / "images.txt", "img_03.png"
    else:
        transforms_folder(tmp_path)
        text, old = tmp_path / "transforms.json", "r_1"
    text.write_text(text.read_text().replace(old, old.partition(".")[0] + ".Png"))
    before = len(load_dataset(tmp_path).views)
    file = tmp_path / "images" / (old.partition(".")[0] + ".png")
    file.rename(file.with_suffix(".PNG"))
    assert len(load_dataset(tmp_path).views) == before


def test_the_extension_that_is_left_out_is_a_lower_one_first(tmp_path):
    """As it was before others were looked for."""
    transforms_folder(tmp_path)
    for file in (tmp_path / "images").iterdir():
        file.rename(file.with_suffix(".PNG"))
    write_images(tmp_path / "images", ["r_1.jpg"], color=(0, 0, 255))
    image = next(view.image for view in load_dataset(tmp_path).views if view.name == "r_1")
    assert image[0, 0, 2] > 0.9 and image[0, 0, 0] < 0.1
