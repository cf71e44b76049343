"""Drivers tell the modifier that draws of the active camera, and are made anew where Blender has taken them away."""

import bpy
import pytest
from model_files import load
from references import place_camera

from blender_addon.nodes.modifier import get_input, is_driven, splat_modifier


def focal(scene) -> float:
    """What the modifier of the active object draws with."""
    seen = bpy.context.object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return get_input(splat_modifier(seen), "Focal X")


def clear(obj) -> None:
    obj.animation_data_clear()


def link(obj) -> None:
    """Animation data of a cube in place of its own."""
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.keyframe_insert("location", frame=1)
    obj.select_set(True)
    bpy.ops.object.make_links_data(type="ANIMATION")


def add_by_hand(obj) -> None:
    """Remove the modifier, and add its tree as any other of Geometry Nodes."""
    tree = splat_modifier(obj).node_group
    obj.modifiers.clear()
    clear(obj)
    obj.modifiers.new('By "hand"', "NODES").node_group = tree


@pytest.mark.parametrize("spoil", [clear, link, add_by_hand])
def test_drivers_that_blender_takes_away_come_back(scene, model, spoil):
    place_camera(scene, "dog")
    obj = load(model)
    before = focal(scene)
    spoil(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.context.view_layer.update()
    assert is_driven(splat_modifier(obj)) and focal(scene) == pytest.approx(before)
    scene.camera.data.lens *= 2
    assert focal(scene) == pytest.approx(2 * before)


def test_muted_drivers_stay_muted(scene, model):
    place_camera(scene, "dog")
    obj = load(model)
    for driver in obj.animation_data.drivers:
        driver.mute = True
    obj.update_tag()
    bpy.context.view_layer.update()
    assert all(driver.mute for driver in obj.animation_data.drivers)
