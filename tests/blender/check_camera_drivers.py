"""Drivers tell the modifier that draws of the active camera, and are made anew where Blender has taken them away."""

import bpy
import pytest
from model_files import load
from references import place_camera

from blender_addon.cameras.objects import camera_numbers
from blender_addon.nodes.modifier import EXPRESSIONS, get_input, is_driven, splat_modifier
from blender_addon.nodes.tree import CAMERA_INPUTS


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


def age(obj) -> None:
    """As an older version of the add-on has made it."""
    obj.animation_data.drivers[1].driver.expression = "rx / 7"
    obj.update_tag()


@pytest.mark.parametrize("spoil", [clear, link, add_by_hand, age])
def test_drivers_that_are_gone_or_old_come_back(scene, model, spoil):
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


@pytest.mark.parametrize("percent, aspect, fit", [(33, (1, 1.3), "AUTO"), (67, (1.6, 1), "VERTICAL")])
@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_a_picture_has_whole_pixels(scene, model, percent, aspect, fit, kind):
    """Also where a percentage of its size is no whole number."""
    place_camera(scene, "dog")
    obj, render, data = load(model), scene.render, scene.camera.data
    render.resolution_percentage, (render.pixel_aspect_x, render.pixel_aspect_y) = percent, aspect
    data.type, data.sensor_fit, data.shift_x, data.shift_y = kind, fit, 0.1, -0.2
    bpy.context.view_layer.update()
    expected = camera_numbers(scene, scene.camera)
    assert (expected.width, expected.height) == (96 * percent // 100, 64 * percent // 100)
    seen = splat_modifier(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    found = [get_input(seen, name) for name in CAMERA_INPUTS]
    assert found == pytest.approx([getattr(expected, name) for name in ("fx", "fy", "cx", "cy", "width", "height")])


def test_expressions_are_as_short_as_blender_wants_them(scene, model):
    drivers = load(model).animation_data.drivers
    assert sorted(curve.driver.expression for curve in drivers) == sorted(EXPRESSIONS.values())
    assert all(curve.driver.is_simple_expression for curve in drivers)  # no Python, which a file may not be let run
