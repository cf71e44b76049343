"""Objects that settings of a training name are deleted as all others are: they leave the file, and undo has them."""

import bpy
import pytest
from model_files import load

from blender_addon.training.rig_operator import make_rig


@pytest.fixture
def named(subject, scene, model):
    """A subject, the model that was made of it, and a region; all are deleted when the check begins."""
    make_rig(bpy.context)
    settings = scene.dogsplat_training
    settings.result, settings.region = load(model), bpy.data.objects.new("Region", None)
    scene.collection.objects.link(settings.region)
    names = [subject.name, settings.result.name, settings.region.name]
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.object.select_all(action="DESELECT")
    for name in names:
        bpy.data.objects[name].select_set(True)
    bpy.ops.object.delete()
    bpy.ops.ed.undo_push(message="delete")
    return names


def test_a_saved_file_has_none_of_them(named, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert not set(named) & set(bpy.data.objects.keys()) and "dog" not in bpy.data.meshes
    settings = bpy.context.scene.dogsplat_training
    assert settings.result is None and settings.region is None and settings.objects() == []
    with pytest.raises(RuntimeError, match="cameras were made for are deleted; select others"):
        bpy.ops.dogsplat.render_views()


def test_they_count_no_more_before_it_is_saved(named, scene):
    settings = scene.dogsplat_training
    assert settings.objects() == []
    with pytest.raises(RuntimeError, match="cameras were made for are deleted; select others"):
        bpy.ops.dogsplat.render_views()
    settings.subject = "REGION"
    with pytest.raises(RuntimeError, match="no region is chosen"):
        bpy.ops.dogsplat.make_cameras()


def test_undo_brings_them_back_after_the_file_was_saved(named, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.ed.undo()
    settings = bpy.context.scene.dogsplat_training
    assert [settings.objects()[0].name, settings.result.name, settings.region.name] == named
    assert len(settings.result.data.vertices) == 150
    bpy.ops.ed.redo()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert not set(named) & set(bpy.data.objects.keys())
