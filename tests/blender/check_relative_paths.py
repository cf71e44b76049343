"""Paths that begin with // are beside the .blend file, as everywhere in Blender, and not at the root of the disk."""

import json

import bpy
import numpy as np
import pytest
from model_files import load
from references import place_camera

# Blender 5 tells of operators that do not declare it, as its own helper classes for imports and exports
pytestmark = pytest.mark.filterwarnings("ignore:.*blend relative:RuntimeWarning")


@pytest.fixture
def folder(scene, tmp_path):
    """Of the file."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    return tmp_path


def test_models_go_out_and_come_back(scene, folder, model):
    load(model)
    bpy.ops.export_scene.dogsplat(filepath="//out.ply")
    assert (folder / "out.ply").read_bytes() == model.read_bytes()
    bpy.ops.import_scene.dogsplat(filepath="//out.ply")
    bpy.ops.import_scene.dogsplat(directory="//", files=[{"name": "out.ply"}])
    assert len(scene.objects) == 3


def test_camera_paths_go_out_and_come_back(scene, folder):
    place_camera(scene, "square")
    scene.frame_end = 2
    bpy.ops.export_scene.dogsplat_path(filepath="//path.json")
    assert len(json.loads((folder / "path.json").read_text())["keys"]) == 2
    bpy.ops.import_scene.dogsplat_path(filepath="//path.json")
    assert len(scene.objects) == 2


def test_cameras_come_in(scene, folder):
    frame = {"file_path": "a.png", "w": 8, "h": 6, "fl_x": 9.0, "transform_matrix": np.eye(4).tolist()}
    (folder / "data").mkdir()
    (folder / "data" / "transforms.json").write_text(json.dumps({"frames": [frame]}))
    bpy.ops.import_scene.dogsplat_cameras(filepath="//data")
    assert [obj.type for obj in scene.objects] == ["CAMERA"]
