"""Splats follow what Blender does to their places: applied transforms, mirrors, parts turned in edit mode."""

import bpy
import numpy as np
import pytest
from edits import PLACED, TURN, shown
from mathutils import Matrix
from model_files import load
from model_values import assert_equal, assert_moved, covariances

from blender_addon.files.motion import motions
from blender_addon.files.ply import read_ply
from blender_addon.nodes.modifier import edit_modifiers, get_input, input_property, set_input
from blender_addon.objects.attributes import read_attributes


def test_splats_follow_blenders_own_apply_transform(model):
    obj, raw = load(model), read_ply(model)
    obj.matrix_world = PLACED
    bpy.context.view_layer.update()
    assert bpy.ops.object.transform_apply() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert obj.matrix_world == Matrix.Identity(4)
    assert_moved(read_attributes(obj.data), raw, np.array(PLACED))


@pytest.mark.parametrize("apply", [bpy.ops.object.transform_apply, lambda: bpy.ops.dogsplat.apply_transform()])
def test_limits_on_sizes_leave_the_same_splats_of_a_model_that_is_scaled(model, apply):
    """By Blender's tool and by ours: sizes are those of the object's space."""
    obj = load(model)
    sizes = np.exp(read_attributes(obj.data).log_scales).max(axis=1)
    least, most = np.quantile(sizes, (0.3, 0.7))
    bpy.ops.dogsplat.add_limits()
    limits = edit_modifiers(obj)[0]
    set_input(limits, "Minimum Size", float(least))
    set_input(limits, "Maximum Size", float(most))
    keep = (sizes > least) & (sizes < most)
    obj.scale = 0.01, 0.01, 0.01
    bpy.context.view_layer.update()
    apply()
    bpy.context.view_layer.update()
    assert get_input(limits, "Minimum Size") == pytest.approx(0.01 * least, rel=1e-4)
    assert shown(obj).n_splats == keep.sum() > 20


@pytest.mark.parametrize("apply", [bpy.ops.object.transform_apply, lambda: bpy.ops.dogsplat.apply_transform()])
def test_keys_of_limits_leave_the_same_splats_of_a_model_that_is_scaled(model, apply):
    """In each frame; those of an action that another object has too are not touched."""
    obj = load(model)
    bpy.ops.dogsplat.add_limits()
    limits = edit_modifiers(obj)[0]
    owner, path = input_property(limits, "Minimum Size")
    for frame, size in ((1, 0.1), (3, 0.3)):
        set_input(limits, "Minimum Size", size)
        owner.keyframe_insert(path, frame=frame)
    found = []
    for others in (0, 1):
        other = bpy.data.objects.new("other", None)
        if others:
            other.animation_data_create().action = obj.animation_data.action
            if hasattr(obj.animation_data, "action_slot"):
                other.animation_data.action_slot = obj.animation_data.action_slot
        obj.scale = 0.5, 0.5, 0.5
        bpy.context.view_layer.update()
        apply()
        bpy.context.view_layer.update()
        for frame in (1, 2, 3):
            bpy.context.scene.frame_set(frame)
            found.append(get_input(limits, "Minimum Size"))
    assert found == pytest.approx([0.05, 0.1, 0.15] * 2, rel=1e-4)


def test_limits_stay_where_a_part_is_scaled(model):
    obj = load(model)
    bpy.ops.dogsplat.add_limits()
    set_input(edit_modifiers(obj)[0], "Minimum Size", 0.1)
    obj.data.vertices.foreach_set("select", np.arange(150) < 60)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.transform.resize(value=(2, 2, 2), center_override=(0, 0, 0))
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    assert get_input(edit_modifiers(obj)[0], "Minimum Size") == pytest.approx(0.1)


@pytest.mark.parametrize("scale", [(-1.5, 1.5, 1.5), (1, 2, 0.7)])
def test_splats_follow_blenders_own_mirrors_and_stretches(model, scale):
    obj, raw = load(model), read_ply(model)
    obj.scale = scale
    bpy.context.view_layer.update()
    bpy.ops.object.transform_apply()
    bpy.context.view_layer.update()
    found, matrix = read_attributes(obj.data), np.diag([*scale, 1])
    if scale[0] < 0:
        assert_moved(found, raw, matrix)
    expected = matrix[:3, :3] @ covariances(raw) @ matrix[:3, :3]
    assert np.allclose(covariances(found), expected, rtol=1e-3, atol=1e-5 * np.abs(expected).max())
    assert np.array_equal(found.logit_opacities, raw.logit_opacities)


def test_splats_follow_a_shift_without_losing_a_bit_of_the_rest(model):
    obj, raw = load(model), read_ply(model)
    obj.location = 1, 2, 3
    bpy.context.view_layer.update()
    bpy.ops.object.transform_apply()
    bpy.context.view_layer.update()
    found = read_attributes(obj.data)
    assert np.allclose(found.means, raw.means + (1, 2, 3), atol=1e-6)
    found.means = raw.means
    assert_equal(found, raw)


def test_a_part_that_is_turned_in_edit_mode_turns_its_splats(model):
    """And one splat that is dragged elsewhere afterwards keeps its own values."""
    obj, raw = load(model), read_ply(model)
    part = np.arange(raw.n_splats) < 60
    obj.data.vertices.foreach_set("select", part)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.transform.rotate(value=0.7, orient_axis="Z", center_override=(0, 0, 0))
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    found = read_attributes(obj.data)
    assert_equal(found.select(~part), raw.select(~part))
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.lstsq(raw.means[part], found.means[part], rcond=None)[0].T
    assert abs(np.linalg.det(matrix) - 1) < 1e-4 and abs(matrix[0, 1]) > 0.5
    assert_moved(found.select(part), raw.select(part), matrix)
    obj.data.vertices[0].co.x += 1
    obj.data.update()
    bpy.context.view_layer.update()
    moved = read_attributes(obj.data)
    assert moved.means[0, 0] == found.means[0, 0] + 1
    moved.means = found.means
    assert_equal(moved, found)


def test_a_linked_duplicate_follows_when_the_other_one_leaves_edit_mode(model, capfd):
    obj, raw = load(model), read_ply(model)
    bpy.ops.object.duplicate(linked=True)
    other = bpy.context.object
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.mirror(constraint_axis=(True, False, False), center_override=(0, 0, 0))
    other.update_tag(refresh={"DATA"})
    bpy.context.view_layer.update()
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    assert_moved(read_attributes(other.data), raw, np.diag([-1.0, 1, 1, 1]))
    assert "Traceback" not in "".join(capfd.readouterr())  # handlers only print theirs


def test_motions_are_found_in_any_order_of_what_was_joined():
    rng = np.random.default_rng(0)
    before = rng.normal(size=(1000, 3)).astype(np.float32)
    after = before.copy()
    stretched = Matrix.Rotation(1.0, 4, "X") @ Matrix.Diagonal((1, -2, 0.6, 1))
    pieces = {(0, 300): TURN, (300, 637): stretched, (800, 1000): PLACED}
    for (a, b), matrix in pieces.items():
        m = np.array(matrix)
        after[a:b] = before[a:b] @ m[:3, :3].T + m[:3, 3]
    after[700] += 1
    found = {}
    for rows, matrix in motions(before, after):
        key = tuple(np.round(matrix, 3).ravel())
        found.setdefault(key, []).extend(rows.tolist())
    assert {tuple(sorted(rows)) for rows in found.values()} == {tuple(range(a, b)) for a, b in pieces}


@pytest.mark.parametrize("sizes", [(300, 40, 12, 90, 8), (8, 20, 30), (500, 100, 700, 66), (9, 2000, 11)])
def test_motions_of_small_objects_are_found_beside_others(sizes):
    """The first object stays where it was, as the active one of a join does."""
    rng = np.random.default_rng(1)
    before = rng.normal(size=(sum(sizes), 3)).astype(np.float32)
    after, objects = before.copy(), np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
    for k, rows in enumerate(objects[1:], start=1):
        m = np.array(Matrix.Translation((k, 2, -k)) @ Matrix.Rotation(k, 4, (1, k, 2)) @ Matrix.Scale(1 / k, 4))
        after[rows] = before[rows] @ m[:3, :3].T + m[:3, 3]
    found = motions(before, after)
    assert sorted(np.concatenate([rows for rows, _ in found])) == list(range(sizes[0], sum(sizes)))
    for rows, matrix in found:
        assert np.abs(before[rows] @ matrix[:3, :3].T + matrix[:3, 3] - after[rows]).max() < 1e-4
        assert len({k for k, of in enumerate(objects) if np.isin(rows, of).any()}) == 1


def test_a_splat_far_away_excuses_no_motion():
    """Turns by so little that it would be nothing for a model of that extent, and a splat that is dragged as far."""
    rng = np.random.default_rng(2)
    before = rng.normal(size=(300, 3)).astype(np.float32)
    before[0] = 1e5, 0, 0
    turn, after = np.array(Matrix.Rotation(0.1, 4, (1, 2, 3))), before.copy()
    after[100:200] = before[100:200] @ turn[:3, :3].T
    ((rows, matrix),) = motions(before, after)
    assert rows.tolist() == list(range(100, 200)) and np.allclose(matrix, turn, atol=1e-5)
    after[200:250] = before[200:250] @ turn[:3, :3] + 0.1
    assert sorted(np.concatenate([rows for rows, _ in motions(before, after)])) == list(range(100, 250))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_splats_follow_beside_one_that_is_nowhere(model, capfd, bad):
    """A script or a modifier may have put it there; it says nothing on how the others moved."""
    raw, obj = read_ply(model), load(model)
    obj.data.vertices[7].co = (bad, 0, 0)
    obj.data.update()
    obj.matrix_world = PLACED
    bpy.context.view_layer.update()
    bpy.ops.object.transform_apply()
    bpy.context.view_layer.update()
    others = np.arange(raw.n_splats) != 7
    assert_moved(read_attributes(obj.data).select(others), raw.select(others), np.array(PLACED))
    assert "Traceback" not in "".join(capfd.readouterr())  # handlers only print theirs


def test_a_splat_that_is_dragged_stays_there_beside_one_far_away(model):
    obj = load(model)
    obj.data.vertices[0].co = 1e5, 0, 0
    obj.data.update()
    bpy.context.view_layer.update()
    place = obj.data.vertices[1].co.copy()
    obj.data.vertices[1].co.x += 0.02
    obj.data.update()
    bpy.context.view_layer.update()
    assert obj.data.vertices[1].co.x == pytest.approx(place.x + 0.02, abs=1e-6)
