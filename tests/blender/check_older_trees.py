"""Trees of older versions of the add-on give way to those of this one, and what people have set stays."""

import bpy
import pytest
from edits import cropped, shown
from model_files import load
from model_values import assert_equal
from references import place_camera

from blender_addon.nodes.fields import PARALLEL
from blender_addon.nodes.groups import SPACE, cached_group, is_current
from blender_addon.nodes.material import VERSION
from blender_addon.nodes.modifier import get_input, input_property, set_input, splat_modifier, tree_name
from blender_addon.nodes.suited import is_suited
from blender_addon.nodes.tree import PROJECTION

NAME = "Model"
SET = {  # by tree
    "DoG Splat": {"Near Clip": 0.7, "Show As": "Ellipsoids", "DoG": False},
    "DoG Splat Crop": {"Invert": True},
    "DoG Splat Limits": {"Minimum Opacity": 0.1, "Maximum Count": 100, "Count By": "Opacity"},
    "DoG Splat Paint": {"Threshold": 0.75},
}


def edited(scene, model):
    """A model with all of our modifiers, with a setting that is keyed and with drivers."""
    place_camera(scene, "dog")
    obj = load(model)
    obj.name = NAME
    cropped(obj, "BOX")
    bpy.ops.dogsplat.add_limits()
    bpy.ops.dogsplat.paint(what="ERASE")
    bpy.ops.dogsplat.finish_painting()
    for modifier in obj.modifiers:
        for name, value in SET[tree_name(modifier)].items():
            set_input(modifier, name, value)
    for frame, share in ((1, 0.2), (11, 0.8)):
        set_input(splat_modifier(obj), "Viewport Share", share)
        owner, key = input_property(splat_modifier(obj), "Viewport Share")
        owner.keyframe_insert(key, frame=frame)
    scene.frame_set(11)
    return obj


def saved_by(version, path):
    """The file, as that version of the add-on would have left it: its trees do nothing, and ask for no projection."""
    owner, key = input_property(splat_modifier(bpy.data.objects[NAME]), PROJECTION)
    owner.driver_remove(key)
    for data in (*bpy.data.node_groups, *bpy.data.materials):
        if "dogsplat" in data:
            data["dogsplat"] = f"{data['dogsplat'].rpartition(' ')[0]} {version}"
    for modifier in bpy.data.objects[NAME].modifiers:
        links = modifier.node_group.links
        nodes = modifier.node_group.nodes
        links.clear()
        links.new(nodes["Group Input"].outputs[0], nodes["Group Output"].inputs[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def are_current(obj):
    return [is_current(modifier.node_group, tree_name(modifier)) for modifier in obj.modifiers]


def opened(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))


def appended(path):
    import addon_utils  # found once bpy is there

    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("blender_addon")
    place_camera(bpy.context.scene, "dog")
    bpy.ops.wm.append(directory=str(path / "Object"), filename=NAME)
    bpy.context.view_layer.update()
    bpy.context.scene.frame_set(11)


@pytest.mark.parametrize("come", [opened, appended])
def test_trees_of_an_older_version_give_way_and_settings_stay(scene, model, tmp_path, come):
    obj = edited(scene, model)
    assert are_current(obj) == [True] * 4
    expected = shown(obj)
    saved_by(VERSION - 1, tmp_path / "old.blend")
    come(tmp_path / "old.blend")
    obj = bpy.data.objects[NAME]
    assert are_current(obj) == [True] * 4
    assert_equal(shown(obj), expected)
    for modifier in obj.modifiers:
        for name, value in SET[tree_name(modifier)].items():
            assert get_input(modifier, name) == pytest.approx(value)
    assert get_input(next(m for m in obj.modifiers if tree_name(m) == "DoG Splat Crop"), "Object") is not None
    bpy.context.scene.camera.data.lens *= 2
    before = get_input(splat_modifier(obj), "Focal X")
    bpy.context.scene.frame_set(6)
    seen = splat_modifier(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    assert get_input(seen, "Focal X") == pytest.approx(2 * before) and 0.2 < get_input(seen, "Viewport Share") < 0.8
    bpy.context.scene.camera.data.type = "ORTHO"
    bpy.context.view_layer.update()
    seen = splat_modifier(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    assert get_input(seen, PROJECTION) == PARALLEL
    if hasattr(bpy.data, "colorspace"):  # from Blender 5.0 on
        bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=True)
        bpy.context.view_layer.update()
        assert are_current(obj) == [True] * 4 and is_suited(obj)


def test_trees_of_a_newer_version_stay(scene, model, tmp_path):
    edited(scene, model)
    saved_by(VERSION + 1, tmp_path / "new.blend")
    opened(tmp_path / "new.blend")
    obj = bpy.data.objects[NAME]
    assert are_current(obj) == [False] * 4 and all(len(modifier.node_group.links) == 1 for modifier in obj.modifiers)


def test_every_tree_is_found_again_and_made_once(scene, model):
    """By its name; another working space shares those that know of no colors."""
    edited(scene, model)
    for group in bpy.data.node_groups:
        assert cached_group(group["dogsplat"].rpartition(" ")[0], group.get(SPACE, "")) == group
        assert group["dogsplat"].startswith("DoG Splat")
