"""Captures of which no poses can be found, or hardly any: one line says why, and what to do."""

import dataclasses
import shutil

import numpy as np
import pytest
from command_line import run
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.scene.cameras import affine, inverse_rigid
from mi_dogsplat.support.errors import DataError
from posed_room import SIZE, folder_of

from benchmarks.poses.filmed_scene import arc, picture, textured_room, write_video


def test_a_camera_that_only_turns_is_told_to_walk(tmp_path, capsys):
    scene, base, pictures = textured_room(), arc(1, *SIZE)[0], []
    for angle in np.linspace(-0.3, 0.3, 5):
        turn = affine([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        camera = dataclasses.replace(base, w2c=inverse_rigid(base.c2w @ turn))
        pictures.append(picture(scene, [camera], 4))
    turning = folder_of(tmp_path / "turning", pictures)
    result = run(capsys, "poses", turning, "-o", tmp_path / "out")
    line = result[2].splitlines()[-1]
    assert result[0] == 2 and line.startswith(f"dogsplat: {turning}: no poses found: the camera turns but"), line
    assert line.endswith("; walk sideways or around the scene")


def test_a_background_that_stands_still_is_told_to_be_masked(pixels, tmp_path):
    still = [p.copy() for p in pixels[2:6]]
    for p in still:
        p[:, :110] = pixels[0][:, :110]
    try:
        told = "\n".join(find_poses(folder_of(tmp_path / "in", still), tmp_path / "out", PosesConfig()).lines())
    except DataError as error:
        told = str(error)
    assert "stands still while the rest moves (100% of the pairs)" in told and "--masks" in told


def test_pictures_without_texture_are_told_so(tmp_path):
    grey = folder_of(tmp_path / "in", [np.full((90, 120, 3), 99, np.uint8)] * 3)
    with pytest.raises(DataError, match="too few features") as raised:
        find_poses(grey, tmp_path / "out", PosesConfig())
    assert "\n" not in str(raised.value) and "patterned" in str(raised.value)


def test_what_is_no_capture_is_one_line(tmp_path, capsys, pixels):
    empty, single, phone, broken = (tmp_path / name for name in ("empty", "single", "phone", "broken"))
    empty.mkdir()
    folder_of(single, pixels[:1])
    folder_of(phone, pixels[:2])
    (phone / "IMG_1.AVIF").write_bytes(b"")
    folder_of(broken, pixels[:3])
    data = (broken / "1.png").read_bytes()
    (broken / "1.png").write_bytes(data[: len(data) // 2])
    text, video, nothing = tmp_path / "notes.txt", tmp_path / "walk.mp4", tmp_path / "nothing"
    text.write_text("Tuesday, cloudy")
    video.write_bytes(b"\0" * 5000)
    for path, *words in (
        (empty, "has no image"),
        (single, "has a single image", "20 to 200"),
        (single / "0.png", "is a single image", "give a folder"),
        (phone, "AVIF images", "export them as JPEG"),
        (text, "is neither a folder of images nor a video"),
        (nothing, "no such file"),
        (broken, "1.png", "cannot be read as an image"),
        (video, "cannot be read as a video", "export it again"),
    ):
        status, out, err = run(capsys, "poses", path, "-o", tmp_path / "out")
        assert status == 2 and err.splitlines()[-1].startswith("dogsplat: ") and "Traceback" not in err, err
        assert all(word in err.splitlines()[-1] for word in words), err
        assert path == broken or not (tmp_path / "out").exists()  # it may be left out, and the rest is kept
        shutil.rmtree(tmp_path / "out", ignore_errors=True)


def test_a_training_on_a_video_that_cannot_be_read_leaves_no_folder(tmp_path, capsys):
    (tmp_path / "walk.mp4").write_bytes(b"\0" * 5000)
    status, _, err = run(capsys, "train", tmp_path / "walk.mp4", "-o", tmp_path / "run")
    assert status == 2 and "cannot be read as a video" in err.splitlines()[-1]
    assert not (tmp_path / "run").exists()


def test_a_video_in_which_nothing_moves_is_one_line(tmp_path, pixels):
    write_video(tmp_path / "still.mp4", [pixels[0]] * 20)
    with pytest.raises(DataError, match="nothing moves in it; walk around"):
        find_poses(tmp_path / "still.mp4", tmp_path / "out", PosesConfig())
