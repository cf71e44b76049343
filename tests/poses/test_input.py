"""Which files are taken for a capture, by their names."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from mi_dogsplat.cli.pose_search import search_poses
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.input import find_photographs, mask_folder, needs_poses, require_input
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.report.run_folder import CONFIG, HISTORY
from mi_dogsplat.support.errors import DataError


def touch(top: Path, *names: str) -> Path:
    for name in names:
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).write_bytes(b"")
    return top


def test_images_are_found_below_a_folder_but_not_masks_copies_hidden_files_and_results(tmp_path):
    touch(tmp_path, "b.JPG", "a.png", "left/1.jpeg", "x.txt")
    touch(tmp_path, "masks/a.png", ".thumbs/a.png", "._a.png", "out/images/a.png")
    assert list(find_photographs(tmp_path, tmp_path / "out")) == ["a.png", "b.JPG", "left/1.jpeg"]
    assert mask_folder(tmp_path, None) == tmp_path / "masks"
    touch(tmp_path, "images/c.png", "images/d.png", "images_4/c.png")
    assert list(find_photographs(tmp_path, tmp_path / "out")) == ["c.png", "d.png"]


@pytest.mark.parametrize("name", ["masks", "Masks", "MASKS"])
def test_a_folder_of_masks_is_told_in_any_case(tmp_path, name):
    touch(tmp_path, "1.jpg", "2.jpg", f"{name}/1.jpg", f"left/{name}/1.png")
    assert mask_folder(tmp_path, None) == tmp_path / name
    assert list(find_photographs(tmp_path, tmp_path / "out")) == ["1.jpg", "2.jpg"]


def test_photographs_beside_a_folder_called_images_are_said_not_to_be_taken(tmp_path, capsys, monkeypatch):
    """As a capture has them in which somebody has made a folder of that name; copies in other folders are none."""
    touch(tmp_path, "1.jpg", "2.HEIC", "._1.jpg", ".DS_Store", "images_4/a.png", "images/a.png")
    with pytest.raises(DataError, match="images: has a single image, .*; move the 2 images beside it into it"):
        find_photographs(tmp_path, tmp_path / "out")
    touch(tmp_path, "images/b.png")
    assert list(find_photographs(tmp_path, tmp_path / "out")) == ["a.png", "b.png"]
    summary = SimpleNamespace(lines=list)
    monkeypatch.setattr("mi_dogsplat.poses.run.find_poses", lambda *arguments: summary)
    search_poses(tmp_path, tmp_path / "out", PosesConfig())
    said = f"{tmp_path}: not read: 2 images of this folder, such as 1.jpg: only images in {tmp_path / 'images'}"
    assert said in capsys.readouterr().out
    search_poses(tmp_path, tmp_path / "out", PosesConfig(masks=str(tmp_path)))
    search_poses(tmp_path / "images", tmp_path / "out", PosesConfig())
    assert "not read" not in capsys.readouterr().out


def test_masks_within_the_folder_are_no_photographs_whatever_their_folder_is_called(tmp_path):
    touch(tmp_path, "1.jpg", "2.jpg", "left/3.jpg", "left/black/1.png", "left/black/left/3.png")
    found = ["1.jpg", "2.jpg", "left/3.jpg"]
    assert list(find_photographs(tmp_path, tmp_path / "out", mask_folder(tmp_path, f"{tmp_path}/left/black"))) == found
    (tmp_path / "in" / "images").mkdir(parents=True)
    touch(tmp_path / "in", "images/1.jpg", "images/2.jpg")
    assert list(find_photographs(tmp_path / "in", tmp_path / "out", tmp_path / "in")) == ["1.jpg", "2.jpg"]


def test_results_of_other_starts_within_the_folder_are_no_photographs(tmp_path):
    touch(tmp_path, "1.jpg", "2.jpg", f"run/{HISTORY}", f"run/{CONFIG}", "run/test/1.png", "run/posed/poses.json")
    touch(tmp_path, "run/posed/images/1.jpg", "posed/poses.json", "posed/images/1.jpg", "frames/film.json")
    touch(tmp_path, "frames/0000.png", "left/3.jpg", "left/renders/capture.json", "left/renders/images/1.png")
    touch(tmp_path, "of_another/config.json", "of_another/4.jpg")
    assert list(find_photographs(tmp_path, tmp_path / "out")) == ["1.jpg", "2.jpg", "left/3.jpg", "of_another/4.jpg"]
    assert needs_poses(tmp_path)
    assert not needs_poses(touch(tmp_path / "films", "a/film.json", "a/0000.png"))


def test_results_are_left_out_by_whichever_name(tmp_path, monkeypatch):
    touch(tmp_path / "photos", "1.jpg", "2.jpg", "out/images/1.jpg")
    (tmp_path / "link").symlink_to(tmp_path / "photos")
    monkeypatch.chdir(tmp_path)
    for folder in ("photos", "../" + tmp_path.name + "/photos", "link"):
        for out in ("photos/out", tmp_path / "photos" / "out", "link/out"):
            assert list(find_photographs(Path(folder), Path(out))) == ["1.jpg", "2.jpg"], (folder, out)


def test_a_picture_in_two_formats_counts_once(tmp_path):
    """As a phone writes HEIC beside its raw file, and whoever exports it writes JPEG beside that."""
    touch(tmp_path, "1.HEIC", "1.DNG", "2.heif", "3.hif", "3.jpg", "0.jpg")
    assert list(find_photographs(tmp_path, tmp_path / "out")) == ["0.jpg", "1.HEIC", "2.heif", "3.jpg"]
    assert needs_poses(touch(tmp_path / "phone", "1.heic"))


def test_raw_files_beside_their_jpeg_do_not_count_others_are_refused(tmp_path):
    touch(tmp_path, "1.jpg", "1.dng", "2.jpg", "2.DNG")
    assert list(find_photographs(tmp_path, tmp_path / "out")) == ["1.jpg", "2.jpg"]
    touch(tmp_path, "3.dng")
    with pytest.raises(DataError, match=r"3.dng: is raw, and others are not \(1 of 3 are such\); export them as"):
        find_photographs(tmp_path, tmp_path / "out")


def test_raw_photographs_and_openexr_are_taken_where_there_is_nothing_else(tmp_path):
    assert list(find_photographs(touch(tmp_path / "raw", "1.dng", "2.NEF", "1.exr"), tmp_path)) == ["1.dng", "2.NEF"]
    assert list(find_photographs(touch(tmp_path / "light", "1.exr", "2.EXR"), tmp_path)) == ["1.exr", "2.EXR"]
    both = touch(tmp_path / "both", "1.jpg", "2.jpg", "1.exr", "depth/1.exr")
    assert list(find_photographs(both, tmp_path)) == ["1.jpg", "2.jpg"]
    for folder in ("raw", "light", "both"):
        assert needs_poses(tmp_path / folder)


def test_linear_asks_for_them_first_and_for_them_alone(tmp_path):
    touch(tmp_path, "1.jpg", "1.cr2", "2.jpg", "2.CR2", "2.exr")
    assert list(find_photographs(tmp_path, tmp_path / "out", linear=True)) == ["1.cr2", "2.CR2"]
    touch(tmp_path, "3.jpg")
    with pytest.raises(DataError, match=r"3.jpg: holds no linear light \(1 of 3 are such\); leave out --linear"):
        find_photographs(tmp_path, tmp_path / "out", linear=True)
    with pytest.raises(DataError, match="jpgs: has no raw photographs and no OpenEXR, whose light --linear keeps"):
        find_photographs(touch(tmp_path / "jpgs", "1.jpg", "2.jpg"), tmp_path / "out", linear=True)


@pytest.mark.parametrize(("name", "kind"), [("3.AVIF", "AVIF"), ("3.jxl", "JXL")])
def test_what_other_cameras_write_is_not_left_out_without_a_word(tmp_path, name, kind):
    touch(tmp_path, "1.jpg", "2.jpg", name)
    with pytest.raises(DataError, match=rf"{name}: {kind} images cannot be read here \(1 of 3"):
        find_photographs(tmp_path, tmp_path / "out")


def test_a_folder_with_a_video_alone_says_which(tmp_path):
    touch(tmp_path, "walk.MOV")
    with pytest.raises(DataError, match="name the video itself: .*walk.MOV"):
        find_photographs(tmp_path, tmp_path / "out")


def test_what_has_cameras_needs_no_poses(tmp_path):
    plain = touch(tmp_path / "plain", "1.jpg")
    assert needs_poses(plain) and needs_poses(str(plain))
    assert not needs_poses(touch(tmp_path / "nerf", "1.jpg", "transforms.json"))
    assert not needs_poses(touch(tmp_path / "colmap", "images/1.jpg", "sparse/0/cameras.bin", "sparse/0/images.bin"))
    assert needs_poses(touch(tmp_path / "new", "1.jxl"))  # so that it is told what to do
    assert needs_poses(touch(tmp_path, "walk.mp4") / "walk.mp4")
    for other in ("scene.xml", "notes.txt", "nothing"):
        assert not needs_poses(tmp_path / other)
    assert not needs_poses(touch(tmp_path / "texts", "a.txt"))


def test_a_folder_around_data_sets_is_no_capture(tmp_path):
    """As an archive that was unpacked into a folder of its name; the search would take their images for one scene."""
    touch(tmp_path, "a/images/1.jpg", "a/images/2.jpg", "a/sparse/0/cameras.txt", "a/sparse/0/images.txt", "README")
    with pytest.raises(DataError, match=f"all of its images lie in folders that have some; give {tmp_path / 'a'}"):
        require_input(tmp_path)
    touch(tmp_path, "b/c/train/1.png", "b/c/transforms_train.json")
    with pytest.raises(DataError, match=f"give one of these, such as {tmp_path / 'a'}"):
        require_input(tmp_path)
    require_input(tmp_path / "a" / "images")
    require_input(tmp_path / "a")  # whose poses may be found anew
    touch(tmp_path, "new/1.jpg")
    require_input(tmp_path)


def test_masks_that_were_given_must_be_there(tmp_path):
    with pytest.raises(DataError, match="no such folder"):
        mask_folder(tmp_path, str(tmp_path / "masks"))
    assert mask_folder(tmp_path, None) is None


def test_a_folder_called_like_a_video_is_a_folder(tmp_path):
    require_input(touch(tmp_path / "walk.mp4", "1.jpg", "2.jpg"))
    assert needs_poses(tmp_path / "walk.mp4")


def test_a_run_is_no_capture_nor_is_what_a_search_has_left(tmp_path):
    """The pictures of a run are renders, and of a search that was stopped some photographs may be missing."""
    run = touch(tmp_path / "run", HISTORY, CONFIG, "test/1.png", "test/1_gt.png", "train/2.png")
    with pytest.raises(DataError, match="run: is a run, and its pictures are renders; .*dogsplat info"):
        require_input(run)
    stopped = touch(tmp_path / "posed", "poses.json", "images/1.jpg", "images/2.jpg")
    with pytest.raises(DataError, match="posed: has no poses yet: .*; give the photographs"):
        require_input(stopped)
    assert needs_poses(run) and needs_poses(stopped)  # so that they are told
    require_input(touch(stopped, "sparse/0/cameras.bin", "sparse/0/images.bin"))  # anew, with another lens
    assert not needs_poses(stopped)


def test_a_capture_that_was_stopped_is_no_photographs(tmp_path):
    """Its cameras are known, and written last: poses would be looked for with the pictures that are there by then."""
    stopped = touch(tmp_path / "data", "capture.json", "images/000.png", "images/001.png")
    assert needs_poses(stopped)  # so that it is told
    with pytest.raises(DataError, match="data: is a capture of a scene that was stopped, .*; let it end: the same"):
        require_input(stopped)
    touch(stopped, "transforms.json")
    assert not needs_poses(stopped)
    require_input(stopped)


def test_a_number_of_frames_is_for_videos(tmp_path):
    with pytest.raises(DataError, match="--frames: is for videos, and .*photos is a folder of images; leave it out"):
        find_poses(touch(tmp_path / "photos", "1.jpg", "2.jpg"), tmp_path / "out", PosesConfig(frames=7))
    assert not (tmp_path / "out").exists()
