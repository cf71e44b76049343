"""What ``dogsplat film`` shows: the model of a run or of a file, its data, and what is up."""

import json
from dataclasses import replace

import mitsuba as mi
import numpy as np
import tiny_data
from command_line import run
from dataset_folders import colmap_folder, write_images
from mi_dogsplat.film.film_config import FilmConfig
from mi_dogsplat.film.make import make_film
from mi_dogsplat.film.subject import read_subject
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.render.viewpoint import viewpoint
from rendered_files import read_png
from scene_files import scene_file

FEW = FilmConfig(seconds=0.25, fps=8, size=(32, 24))


def test_a_run_folder_knows_its_data_and_how_it_is_drawn(model, data, tmp_path, capsys):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "point_cloud.ply").write_bytes(model.read_bytes())
    (folder / "config.json").write_text(json.dumps({"data": str(data), "background": "white", "near_clip": 0.01}))
    status, out, _ = run(
        capsys, "film", folder, "-o", tmp_path / "f", "--path", "cameras", "--smoothing", 0, "--seconds", 1, "--fps", 2
    )
    assert status == 0 and "2 frames of 48 x 36, 1 s; along 8 cameras" in out
    expected = tiny_data.picture(tiny_data.truth(), tiny_data.cameras()[0], background=1.0).color
    shown = read_png(tmp_path / "f" / "0000.png") / 255
    assert abs(shown - expected).max() < 1.5 / 255
    film = make_film(folder, tmp_path / "g", config=FEW)
    assert film.path.startswith("an orbit")  # the cameras of the tiny data stand all around
    (folder / "config.json").write_text(json.dumps({"data": str(tmp_path / "gone")}))
    path = make_film(folder, tmp_path / "h", config=FEW).path
    assert path.startswith("an orbit") and path.endswith("gone, are not there: --data names them)")


def test_an_orbit_goes_around_what_is_up_by_the_data_where_the_model_does_not_say(model, tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data")
    held = read_subject(model, data, PictureOptions()).up
    np.testing.assert_allclose(held, (0, 0, 1), atol=0.02)
    for said, up in (({"up": "x"}, (1, 0, 0)), ({"scale": 2.0}, held)):
        (data / "world.json").write_text(json.dumps(said))
        np.testing.assert_array_equal(read_subject(model, data, PictureOptions()).up, up)


def test_a_film_takes_the_cameras_of_smaller_images_where_there_are_no_others(model, tmp_path):
    """Those that ``train --downscale 4`` is content with."""
    colmap_folder(tmp_path)
    cameras = read_subject(model, tmp_path, PictureOptions()).data.cameras
    (tmp_path / "images").rename(tmp_path / "whole")
    write_images(tmp_path / "images_4", [path.name for path in (tmp_path / "whole").iterdir()], (5, 4))
    found = read_subject(model, tmp_path, PictureOptions()).data.cameras
    np.testing.assert_array_equal([camera.w2c for camera in found], [camera.w2c for camera in cameras])
    assert found[0].width == 5


def test_of_a_scene_as_data_the_cameras_alone_are_wanted(model, tmp_path, monkeypatch):
    """Its pictures would take minutes."""
    scene, asked, render = scene_file(tmp_path), [], mi.render
    monkeypatch.setattr(mi, "render", lambda *args, **named: asked.append(named["spp"]) or render(*args, **named))
    assert len(read_subject(model, scene, PictureOptions()).data.cameras) == 3
    assert viewpoint(tiny_data.truth(), scene).name == "sensor_000"
    assert asked == [1] * 6


def test_a_run_finds_its_data_from_another_working_folder(model, data, tmp_path, monkeypatch):
    folder = tmp_path / "runs" / "first"
    folder.mkdir(parents=True)
    (folder / "point_cloud.ply").write_bytes(model.read_bytes())
    (tmp_path / "photos").symlink_to(data)
    (folder / "config.json").write_text(json.dumps({"data": "photos/"}))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    film = make_film(folder, tmp_path / "f", config=replace(FEW, path="cameras"))
    assert film.path == "along 8 cameras"


def test_photographs_are_followed_as_one_counts(model, data, tmp_path):
    """By the letters of their names they would begin with 10 and end with 9, too short a detour to look for a tour."""
    content, order = json.loads((data / "transforms.json").read_text()), ["9", "10", "11", "100b", "0100c", "a1", "a02"]
    for frame, name in zip(content["frames"], [*order, "b"], strict=True):
        (tmp_path / f"{name}.png").write_bytes((data / frame["file_path"]).read_bytes())
        frame["file_path"] = f"{name}.png"
    del content["ply_file_path"]
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    found = [camera.position for camera in read_subject(model, tmp_path, PictureOptions()).data.cameras]
    np.testing.assert_allclose(found, [camera.position for camera in tiny_data.cameras()], atol=1e-6)


def test_photographs_of_one_side_are_followed(model, tmp_path, monkeypatch):
    some = tiny_data.cameras(16)[:5]
    monkeypatch.setattr(tiny_data, "cameras", lambda n: some)
    one_side = tiny_data.write_tiny_data(tmp_path / "data", n=5)
    assert make_film(model, tmp_path / "f", one_side, FEW).path == "along 5 cameras"
