"""Every step of editing is taken back by undo and comes again by redo."""

import bpy
import pytest
from edits import PLACED, cropped
from model_files import load
from model_values import assert_equal

from blender_addon.files.ply import read_ply
from blender_addon.nodes.modifier import splat_modifier
from blender_addon.objects.attributes import read_attributes


def turn_and_apply():
    bpy.context.object.matrix_world = PLACED
    bpy.context.view_layer.update()
    bpy.ops.dogsplat.apply_transform()


def turn_and_apply_natively():
    bpy.context.object.matrix_world = PLACED
    bpy.context.view_layer.update()
    bpy.ops.object.transform_apply()
    bpy.context.view_layer.update()


def crop_and_apply():
    cropped(bpy.context.object, "BOX")
    bpy.ops.dogsplat.apply_edits()


def paint_and_finish():
    bpy.ops.dogsplat.paint(what="TINT")
    bpy.ops.dogsplat.finish_painting()


STEPS = {
    "crop": lambda: bpy.ops.dogsplat.add_crop(shape="MESH"),
    "limits": lambda: bpy.ops.dogsplat.add_limits(),
    "paint": lambda: bpy.ops.dogsplat.paint(what="ERASE"),
    "paint and finish": paint_and_finish,
    "crop and apply": crop_and_apply,
    "apply the transform": turn_and_apply,
    "apply the transform natively": turn_and_apply_natively,
    "join": lambda: (bpy.ops.object.duplicate(), bpy.data.objects["dog"].select_set(True), bpy.ops.dogsplat.join()),
}


@pytest.mark.parametrize("step", STEPS)
def test_undo_takes_every_step_back_and_redo_brings_it_again(model, step):
    raw = read_ply(model)
    load(model)
    bpy.ops.ed.undo_push(message="before")
    STEPS[step]()
    bpy.ops.ed.undo_push(message=step)
    name = bpy.context.object.name
    after = read_attributes(next(o for o in bpy.data.objects if o.type == "MESH" and splat_modifier(o)).data)
    stacks = {o.name: [m.name for m in o.modifiers] for o in bpy.data.objects}
    bpy.ops.ed.undo()
    bpy.context.view_layer.update()
    assert [(o.name, len(o.modifiers)) for o in bpy.data.objects] == [("dog", 1)]
    assert_equal(read_attributes(bpy.data.objects["dog"].data), raw)
    bpy.ops.ed.redo()
    bpy.context.view_layer.update()
    assert {o.name: [m.name for m in o.modifiers] for o in bpy.data.objects} == stacks
    assert bpy.context.object.name == name
    assert_equal(read_attributes(next(o for o in bpy.data.objects if splat_modifier(o)).data), after)
