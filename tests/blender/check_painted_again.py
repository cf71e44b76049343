"""Painting that goes on after it was applied: what is part of the splats by then is not done to them once more."""

import bpy
import numpy as np
import pytest
from edits import paint, shown
from model_files import load
from model_values import assert_equal

from blender_addon.editing.stand_in import stand_in_of
from blender_addon.files.ply import read_ply
from blender_addon.nodes.modifier import edit_modifiers, set_input
from blender_addon.objects.attributes import read_attributes

TINTED, COLOR = np.arange(60, 90), (1.0, 0.2, 0.05, 1.0)


def stroke(obj, what, rows, **painted):
    """Paint, and leave the mode; the stand-in stays."""
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.dogsplat.paint(what=what) == {"FINISHED"}
    paint(stand_in_of(obj), rows, **painted)
    bpy.ops.object.mode_set(mode="OBJECT")
    select(obj)


def select(obj):
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj


def test_what_blenders_join_adds_to_a_model_that_is_painted_is_not_painted(model):
    """Splats of one that is no stand-in's, and of one that another stand-in is for."""
    first, second, third = load(model), load(model), load(model)
    raw = read_ply(model)
    stroke(third, "ERASE", np.arange(5), weight=1.0)
    stroke(first, "ERASE", np.arange(5), weight=1.0)
    stroke(first, "TINT", TINTED, color=COLOR)
    own = shown(first)
    assert own.n_splats == raw.n_splats - 5
    for other in (second, third):
        other.select_set(True)
    bpy.ops.object.join()
    bpy.context.view_layer.update()

    def check():
        found = shown(first)
        n = raw.n_splats
        assert found.n_splats == own.n_splats + 2 * n
        assert_equal(found.select(np.arange(own.n_splats)), own)
        for k in (own.n_splats, own.n_splats + n):
            assert_equal(found.select(np.arange(k, k + n)), raw)

    check()
    assert bpy.ops.dogsplat.finish_painting() == {"FINISHED"}
    check()
    assert not any(name.startswith("paint:") for name in first.data.attributes.keys())


@pytest.mark.parametrize("finished", [False, True])
def test_a_tint_that_was_applied_is_there_once(model, finished):
    """Applied while it is painted, and after that."""
    obj, raw = load(model), read_ply(model)
    stroke(obj, "TINT", TINTED, color=COLOR)
    if finished:
        bpy.ops.dogsplat.finish_painting()
    tinted = shown(obj)
    assert np.abs(tinted.sh_coeffs - raw.sh_coeffs)[TINTED].max() > 0.1
    assert bpy.ops.dogsplat.apply_edits() == {"FINISHED"}
    assert_equal(read_attributes(obj.data), tinted)
    stroke(obj, "TINT", np.arange(3), color=(0.5, 0.5, 0.5, 1.0))
    rest = np.arange(3, raw.n_splats)
    assert_equal(shown(obj).select(rest), tinted.select(rest))
    assert not np.array_equal(shown(obj).sh_coeffs[:3], tinted.sh_coeffs[:3])


def test_a_tint_of_a_joined_model_is_there_once(model):
    second, first = load(model), load(model)
    stroke(first, "TINT", TINTED, color=COLOR)
    second.select_set(True)
    assert bpy.ops.dogsplat.join() == {"FINISHED"}
    joined = read_attributes(first.data)
    assert joined.n_splats == 300
    stroke(first, "TINT", np.arange(0))
    assert_equal(shown(first), joined)


def test_what_a_high_threshold_kept_stays_when_erasing_goes_on(model):
    """A new modifier has a threshold of its own."""
    obj = load(model)
    stroke(obj, "ERASE", np.arange(40), weight=1.0)
    stroke(obj, "ERASE", np.arange(40, 60), weight=0.6)
    set_input(edit_modifiers(obj)[0], "Threshold", 0.8)
    kept = shown(obj)
    assert kept.n_splats == 110
    assert bpy.ops.dogsplat.apply_edits() == {"FINISHED"}
    stroke(obj, "ERASE", np.arange(0))
    assert_equal(shown(obj), kept)


@pytest.mark.parametrize("switch", ["Erase", "Tint"])
def test_what_a_modifier_was_told_to_ignore_is_still_there_to_be_painted_on(model, switch):
    obj = load(model)
    stroke(obj, "TINT", TINTED, color=COLOR)
    stroke(obj, "ERASE", np.arange(40), weight=1.0)
    both = shown(obj)
    set_input(edit_modifiers(obj)[0], switch, False)
    assert shown(obj).n_splats == (150 if switch == "Erase" else 110)
    assert bpy.ops.dogsplat.apply_edits() == {"FINISHED"}
    stroke(obj, "TINT", np.arange(0))
    assert_equal(shown(obj), both)


@pytest.mark.parametrize("finished", [False, True])
def test_what_blenders_own_apply_made_real_is_done_once(model, finished):
    """Apply of the modifier itself, while it is painted once more, and after that."""
    obj = load(model)
    stroke(obj, "TINT", TINTED, color=COLOR)
    stroke(obj, "ERASE", np.arange(40), weight=1.0)
    stroke(obj, "ERASE", np.arange(40, 60), weight=0.6)
    bpy.ops.dogsplat.finish_painting()
    set_input(edit_modifiers(obj)[0], "Threshold", 0.8)
    if not finished:
        stroke(obj, "TINT", np.arange(100, 110), color=COLOR)
    kept = shown(obj)
    assert kept.n_splats == 110
    bpy.context.view_layer.update()
    assert bpy.ops.object.modifier_apply(modifier=edit_modifiers(obj)[0].name) == {"FINISHED"}
    assert_equal(read_attributes(obj.data), kept)
    stroke(obj, "TINT", np.arange(0))
    stroke(obj, "ERASE", np.arange(0))
    assert_equal(shown(obj), kept)


@pytest.mark.parametrize("switch", ["Erase", "Tint"])
def test_what_a_modifier_was_told_to_ignore_is_kept_by_blenders_own_apply(model, switch):
    obj = load(model)
    stroke(obj, "TINT", TINTED, color=COLOR)
    stroke(obj, "ERASE", np.arange(40), weight=1.0)
    bpy.ops.dogsplat.finish_painting()
    both = shown(obj)
    set_input(edit_modifiers(obj)[0], switch, False)
    obj.update_tag()
    assert bpy.ops.object.modifier_apply(modifier=edit_modifiers(obj)[0].name) == {"FINISHED"}
    stroke(obj, "TINT", np.arange(0))
    assert_equal(shown(obj), both)
