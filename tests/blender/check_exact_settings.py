"""Set Up Exact Picture, of models in this file and of linked ones."""

import bpy
import pytest
from model_files import load
from scattering import only_as_instance

from blender_addon.nodes.modifier import get_input, splat_modifier


def linear(obj) -> bool:
    return get_input(splat_modifier(obj), "Linear Colors")


def test_models_of_this_file_get_exact_colors(scene, model, capfd):
    obj, output = load(model), scene.render.image_settings
    output.color_management = "OVERRIDE"
    assert linear(obj) and bpy.ops.dogsplat.exact_settings() == {"FINISHED"}
    assert not linear(obj) and scene.view_settings.view_transform == "Raw"
    assert output.color_management == "FOLLOW_SCENE"
    assert "Warning" not in capfd.readouterr().out


@pytest.mark.parametrize("nested", [False, True])
def test_models_that_are_only_instances_get_exact_colors(scene, model, nested):
    obj = only_as_instance(scene, load(model))
    if nested:
        only_as_instance(scene, scene.objects[0])
    assert obj.name not in scene.objects and bpy.ops.dogsplat.exact_settings() == {"FINISHED"}
    assert not linear(obj)


@pytest.mark.parametrize("overridden", [False, True])
def test_a_linked_model_is_said_to_keep_its_colors_unless_it_is_overridden(model, tmp_path, capfd, overridden):
    """As the file says that is opened again."""
    load(model)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "source.blend"), link=True) as (_, wanted):
        wanted.objects = ["dog"]
    (obj,) = wanted.objects
    obj = obj.override_create(remap_local_usages=True) if overridden else obj
    bpy.context.scene.collection.objects.link(obj)
    capfd.readouterr()
    assert bpy.ops.dogsplat.exact_settings() == {"FINISHED"}
    said = [line for line in capfd.readouterr().out.splitlines() if line.startswith("Warning")]
    assert len(said) == (not overridden) and all("dog" in line for line in said)
    now = linear(obj)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "links.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "links.blend"))
    assert linear(next(iter(bpy.context.scene.objects))) == now == (not overridden)
