"""A picture for which there is no memory is refused before it is drawn, in one line; else the process would be gone."""

import json

import mitsuba as mi
import numpy as np
import pytest
from command_line import assert_one_line, run
from mi_dogsplat.render.picture_memory import require_memory
from mi_dogsplat.support.errors import DataError
from scene_files import scene_file


@pytest.fixture(autouse=True)
def two_gigabytes(monkeypatch):
    if not (mi.variant() or "").startswith("llvm"):
        pytest.skip("a GPU has memory of its own")
    monkeypatch.setattr("mi_dogsplat.render.picture_memory.available_memory", lambda: 2 * 10**9)


def not_drawn(*_, **__):
    raise AssertionError("a picture is drawn")


def test_a_render_that_is_too_large_names_a_smaller_one(capsys, model, tmp_path, monkeypatch):
    monkeypatch.setattr("mi_dogsplat.render.render_files.picture_of", not_drawn)
    camera = {"w2c": np.eye(4).tolist(), "fx": 8000, "width": 16000, "height": 16000}
    (tmp_path / "c.json").write_text(json.dumps(camera))
    out = tmp_path / "v.png"
    result = run(capsys, "render", model, "-o", out, "--camera", tmp_path / "c.json")
    said = "16,000 x 16,000 pixels would take 19.2 GB of memory, and 2 GB are free; ask for a smaller picture"
    assert_one_line(result, f"{out}: {said}")


def test_a_scene_whose_film_is_too_large_is_named(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("mitsuba.render", not_drawn)
    path = scene_file(tmp_path)
    large = path.read_text().replace('"width" value="8"', '"width" value="20000"')
    path.write_text(large.replace('"height" value="6"', '"height" value="20000"'))
    result = run(capsys, "render", path, "-o", tmp_path / "s.exr")
    assert_one_line(result, f"{path}: 20,000 x 20,000 pixels would take 52 GB", "make its film smaller")


def test_a_film_whose_frames_are_too_large_names_size(capsys, model, tmp_path, monkeypatch):
    monkeypatch.setattr("mi_dogsplat.film.model_frames.picture_of", not_drawn)
    result = run(capsys, "film", model, "-o", tmp_path / "frames", "--size", 16000, 16000, "--seconds", 0.1)
    assert_one_line(result, "pixels would take", "smaller by --size")
    assert not (tmp_path / "frames").exists()


def test_what_fits_is_drawn_and_more_channels_take_more():
    require_memory("v.png", 4000, 4000, ".png", "")
    with pytest.raises(DataError, match=r"v.exr: 4,000 x 4,000 pixels would take 2.08 GB"):
        require_memory("v.exr", 4000, 4000, ".exr", "")


def test_where_nobody_knows_how_much_is_free_all_is_tried(monkeypatch):
    def unknown():
        raise ModuleNotFoundError("psutil")

    for free in (lambda: None, unknown):
        monkeypatch.setattr("mi_dogsplat.render.picture_memory.available_memory", free)
        require_memory("v.png", 16000, 16000, ".png", "")
