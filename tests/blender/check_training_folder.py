"""Where a training is, and that no scene writes over that of another one."""

import ntpath
import shutil
from pathlib import Path

import bpy
import pytest
from drawn_panels import Layout

from blender_addon.training.folder import training_folder
from blender_addon.training.panel import draw_buttons
from blender_addon.training.rendering import Rendering

BELONGS = 'belongs to the scene "Scene" of .*chair.blend; choose another folder'


def offered(scene) -> list[str]:
    layout = Layout()
    draw_buttons(layout, scene)
    return layout.drawn


def save_as(path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def begin() -> Path:
    """A rendering that is stopped at once, and its folder; there has been a training as well."""
    rendering = Rendering(bpy.context)
    rendering.close()
    folder = rendering.data_set.folder.parent
    (folder / "data" / "transforms.json").write_text("{}")
    (folder / "run").mkdir(exist_ok=True)
    (folder / "run" / "config.json").write_text("{}")
    return folder


def test_each_scene_of_each_file_has_a_folder_of_its_own(scene, tmp_path):
    with pytest.raises(ValueError, match="save the file"):
        training_folder(scene)
    scene.name = "Room 2/3"
    other = bpy.data.scenes.new("Other")
    for name in ("chair", "table"):
        save_as(tmp_path / f"{name}.blend")
        assert training_folder(scene) == tmp_path / "dogsplat_training" / name / "Room_2_3"
        assert training_folder(other) == tmp_path / "dogsplat_training" / name / "Other"
    scene.dogsplat_training.folder = "//mine"
    assert training_folder(scene) == tmp_path / "mine"


def test_the_folder_of_another_file_is_refused_while_that_is_there(subject, scene, tmp_path):
    save_as(tmp_path / "chair.blend")
    folder = begin()
    files = {path: path.read_bytes() for path in folder.rglob("*.json")}
    save_as(tmp_path / "table.blend")
    with pytest.raises(RuntimeError, match=BELONGS) as caught:
        bpy.ops.dogsplat.render_views()
    assert len(str(caught.value).strip().splitlines()) == 1
    assert {path: path.read_bytes() for path in folder.rglob("*.json")} == files
    (refusal,) = offered(scene)
    assert "chair.blend" in refusal and not bpy.ops.dogsplat.train.poll()
    (tmp_path / "chair.blend").unlink()  # it was only given another name
    assert offered(scene)[-2:] == ["dogsplat.train"] * 2 and bpy.ops.dogsplat.train.poll()


def test_the_folder_of_another_scene_is_refused_while_that_is_there(subject, scene, tmp_path):
    save_as(tmp_path / "chair.blend")
    folder, other = begin(), scene.copy()
    with pytest.raises(ValueError, match=BELONGS):
        training_folder(other)
    scene.name = "Renamed"
    assert training_folder(scene) == folder


def test_a_folder_that_is_copied_with_its_file_is_its_own(subject, scene, tmp_path):
    scene.dogsplat_training.folder = "//training"
    (tmp_path / "first").mkdir()
    save_as(tmp_path / "first" / "chair.blend")
    begin()
    shutil.copytree(tmp_path / "first", tmp_path / "second")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "second" / "chair.blend"))
    assert training_folder(bpy.context.scene) == tmp_path / "second" / "training"


def test_the_folder_may_be_on_another_drive_than_the_file(subject, scene, tmp_path, monkeypatch):
    """Of Windows, from which no relative path leads there."""
    monkeypatch.setattr("os.path.relpath", lambda path, start: ntpath.relpath(f"C:{path}", f"D:{start}"))
    save_as(tmp_path / "chair.blend")
    begin()
    assert training_folder(scene) == Path(scene.dogsplat_training.folder)
    save_as(tmp_path / "table.blend")
    with pytest.raises(ValueError, match=BELONGS):
        training_folder(scene)
