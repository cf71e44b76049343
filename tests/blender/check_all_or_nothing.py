"""What edits several models edits all of them or, after an error, none: there is no step that undo could take back."""

from functools import partial
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from edits import paint, shown
from mathutils import Matrix
from model_files import datablocks, load
from model_values import assert_equal

from blender_addon.editing.stand_in import stand_in_of
from blender_addon.native import operators
from blender_addon.nodes.modifier import edit_modifiers, set_input
from blender_addon.objects.attributes import read_attributes


def limited(path, opacity):
    """A model with a limit."""
    obj = load(path)
    bpy.ops.dogsplat.add_limits()
    set_input(edit_modifiers(obj)[-1], "Minimum Opacity", opacity)
    obj.update_tag()
    return obj


def painted(obj, rows):
    """Erase these splats, by a stand-in that stays."""
    bpy.context.view_layer.objects.active = obj
    bpy.ops.dogsplat.paint(what="ERASE")
    stand_in = stand_in_of(obj)
    paint(stand_in, rows, weight=1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    return stand_in


def choose(*objects):
    bpy.ops.object.select_all(action="DESELECT")
    for obj in objects:
        obj.select_set(True)
    bpy.context.view_layer.objects.active = objects[0]
    bpy.context.view_layer.update()


def state(objects):
    return datablocks(), [
        (obj.data.as_pointer(), len(obj.data.vertices), obj.matrix_world.copy(), list(obj.modifiers), stand_in_of(obj))
        for obj in objects
    ]


@pytest.mark.parametrize("operator", [bpy.ops.dogsplat.apply_edits, bpy.ops.dogsplat.join])
def test_a_model_of_which_nothing_is_left_keeps_the_others_as_they_are(model, operator):
    objects = [limited(model, 0.5), limited(model, 1.0)]
    painted(objects[0], np.arange(40))
    choose(*objects)
    before = state(objects)
    with pytest.raises(RuntimeError, match='^Error: "dog.001": no splat is left; open its crop or its limits\n$'):
        operator()
    assert state(objects) == before


@pytest.mark.parametrize(
    "operator", [bpy.ops.dogsplat.apply_edits, bpy.ops.dogsplat.join, bpy.ops.dogsplat.apply_transform]
)
def test_painting_that_nobody_knows_keeps_the_others_as_they_are(model, operator):
    objects = [limited(model, 0.5), limited(model, 0.5)]
    for obj in objects:
        stand_in = painted(obj, np.arange(40))
    stand_in.data["dogsplat_splats"] += 1
    choose(*objects)
    before = state(objects)
    with pytest.raises(RuntimeError, match="the number of its points has changed"):
        operator()
    assert state(objects) == before


def test_what_cannot_be_converted_stays_as_it_is(model, monkeypatch):
    """No Blender of the tests has native splats, but it does not come to that."""

    def fail(command, model):
        raise ValueError("no package")

    monkeypatch.setattr(operators, "baked", fail)
    obj = limited(model, 0.5)
    painted(obj, np.arange(40))
    choose(obj)
    before, said = state([obj]), []
    operator = SimpleNamespace(keep_original=False, report=lambda kind, text: said.append(text))
    operator.convert = partial(operators.Conversion.convert, operator)
    assert operators.DOGSPLAT_OT_to_native.execute(operator, bpy.context) == {"CANCELLED"}
    assert said == ["no package"] and state([obj]) == before


def test_joining_needs_an_active_model_that_is_selected(model):
    """Blender's own Join does as well, and would refuse after the edits are applied."""
    first, second, active = (load(model) for _ in range(3))
    choose(first, second)
    assert bpy.ops.dogsplat.join.poll()
    bpy.context.view_layer.objects.active = active
    assert not bpy.ops.dogsplat.join.poll()


def test_what_is_painted_stays_with_a_modifier_that_is_off(model):
    """Applied are the others; the splats that they leave have what is painted on them."""
    obj = limited(model, 0.5)
    painted(obj, np.arange(40))
    expected = shown(obj)
    painting = next(modifier for modifier in edit_modifiers(obj) if modifier.name == "DoG Splat Paint")
    painting.show_viewport = False
    choose(obj)
    assert bpy.ops.dogsplat.apply_edits() == {"FINISHED"}
    assert edit_modifiers(obj) == [painting] and stand_in_of(obj) is None and len(bpy.data.objects) == 1
    assert read_attributes(obj.data).n_splats > expected.n_splats
    painting.show_viewport = True
    assert_equal(shown(obj), expected)


MOVED = "its constraints would move it once more; apply or mute them first"
KEYED = "keys or drivers of its transform would move it once more; delete or mute them first"
SHAPED = "its shape keys would take its splats back; apply all of them first"


@pytest.mark.parametrize("kind, said", [
    ("constraint", MOVED), ("keys", KEYED), ("track", KEYED), ("driver", KEYED), ("shape keys", SHAPED),
])  # fmt: skip
def test_a_transform_is_not_applied_to_what_would_not_stay(model, kind, said):
    """Until what would move it is muted, or is no more; what is selected beside it stays until then too."""
    other, obj = load(model), load(model)
    other.location.x = obj.location.x = 5
    cause = None
    if kind == "constraint":
        cause = obj.constraints.new("COPY_LOCATION")
        cause.target = other
    elif kind == "shape keys":
        obj.shape_key_add(name="Basis")
    elif kind == "driver":
        cause = obj.driver_add("location", 0)
        cause.driver.expression = "5"
    else:
        obj.keyframe_insert("location", index=0)
        animation = obj.animation_data
        if kind == "track":
            cause = animation.nla_tracks.new()
            cause.strips.new("moves", 1, animation.action)
            animation.action = None
    bpy.context.view_layer.update()
    choose(obj, other)
    before = state([obj, other])
    with pytest.raises(RuntimeError, match=f'^Error: "dog.001": {said}\n$'):
        bpy.ops.dogsplat.apply_transform()
    assert state([obj, other]) == before
    if cause is not None:
        cause.mute = True
    elif kind == "keys":
        obj.keyframe_delete("location", index=0)
    else:
        obj.shape_key_clear()
    assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"} and obj.location.x == other.location.x == 0


def test_a_transform_is_applied_where_keys_do_not_move_the_object(model):
    """Those of another rotation mode, and of what is not a transform."""
    obj = load(model)
    obj.location.x = 5
    for path in ("rotation_quaternion", "pass_index"):
        obj.keyframe_insert(path)
    choose(obj)
    assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"}
    bpy.context.scene.frame_set(2)
    assert obj.matrix_world == Matrix.Identity(4)
