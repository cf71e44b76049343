"""Files whose names are bytes that are no UTF-8, as archives of another system leave them: Blender's file dialog has
them, and its own names and messages cannot."""

import os
import shutil

import bpy
import numpy as np
import pytest
from references import REFERENCES, place_camera

from blender_addon.objects.conventions import SOURCE

NAME = os.fsdecode(b"b\xe4ume")
SHOWN = "b?ume"


@pytest.fixture
def folder(tmp_path):
    """One of such a name."""
    made = tmp_path / NAME
    try:
        made.mkdir()
    except (OSError, UnicodeError):
        pytest.skip("this file system has only names in UTF-8")
    return made


def test_models_come_in_and_go_out(scene, folder):
    path = folder / f"{NAME}.ply"
    shutil.copy(REFERENCES / "dog.ply", path)
    assert bpy.ops.import_scene.dogsplat(filepath=str(path)) == {"FINISHED"}
    assert bpy.context.object.name == SHOWN
    assert bpy.context.object[SOURCE].endswith(f"{SHOWN}/{SHOWN}.ply")
    out = folder / f"{NAME} again.ply"
    assert bpy.ops.export_scene.dogsplat(filepath=str(out)) == {"FINISHED"}
    assert out.read_bytes() == path.read_bytes()


def test_camera_paths_go_out_and_come_in(scene, folder):
    place_camera(scene, "square")
    pose = scene.camera.matrix_world.copy()
    path = folder / f"{NAME}.json"
    bpy.ops.export_scene.dogsplat_path(filepath=str(path))
    assert bpy.ops.import_scene.dogsplat_path(filepath=str(path)) == {"FINISHED"}
    assert scene.camera.name == SHOWN
    assert np.allclose(scene.camera.matrix_world, pose, atol=1e-5)


def test_what_is_wrong_with_them_is_one_line(scene, folder):
    for reading in (
        bpy.ops.import_scene.dogsplat, bpy.ops.import_scene.dogsplat_cameras, bpy.ops.import_scene.dogsplat_path
    ):  # fmt: skip
        with pytest.raises(RuntimeError, match=rf"^Error: \S*{SHOWN.replace('?', '[?]')}/nothing.json: [^\n]*\n?$"):
            reading(filepath=str(folder / "nothing.json"))
    bpy.ops.import_scene.dogsplat(filepath=str(REFERENCES / "dog.ply"))
    with pytest.raises(RuntimeError, match="^Error: [^\n]*cannot be written [^\n]*\n?$"):
        bpy.ops.export_scene.dogsplat(filepath=str(folder / "nowhere" / "out.ply"))
