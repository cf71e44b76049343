"""Blender's own splats: the choice where they are there, and conversions that lose nothing.

No Blender of the tests has them. What 5.3 offers, a type of point clouds, stands in here as a property of that name, so
that everything but the drawing runs.
"""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from drawn_panels import NO_CAMERA, Layout
from edits import PLACED, TURN, cropped, local
from model_files import datablocks, export, load
from model_values import assert_equal
from references import REFERENCES, place_camera

from blender_addon.engine.order import make_order
from blender_addon.files.model import sigmoid
from blender_addon.files.ply import read_ply
from blender_addon.native import bake
from blender_addon.native.convert import replace_object, successor
from blender_addon.nodes.modifier import get_input, set_input, splat_modifier
from blender_addon.objects.attributes import read_attributes
from blender_addon.objects.cloud import read_cloud
from blender_addon.objects.columns import get_column, put_column
from blender_addon.objects.feature import is_available
from blender_addon.package.served import RendererError
from blender_addon.panel import DOGSPLAT_PT_panel


def column(obj, name, width):
    return get_column(obj.data, name, width)


def test_a_blender_without_native_splats_does_not_offer_them(model):
    if is_available():
        pytest.skip("this Blender has native splats")
    load(model)
    assert not bpy.ops.dogsplat.to_native.poll() and not bpy.ops.dogsplat.to_dog.poll()
    with pytest.raises(TypeError, match="NATIVE"):
        bpy.ops.import_scene.dogsplat(filepath=str(model), show_as="NATIVE")


def test_imported_as_native_a_dog_model_is_drawn_as_the_gaussians_of_the_package(native, model, command, tmp_path):
    """Oracle: what the command bakes, while the import asks the package in this process; 5.3's own names and types."""
    raw, before = read_ply(model), datablocks()
    obj = load(model, show_as="NATIVE", up_axis="-Y", scale=2.0)
    assert obj.type == "POINTCLOUD" and obj.data.type == "GAUSSIAN_SPLAT" and not obj.modifiers
    kinds = {a.name: (a.data_type, a.domain) for a in obj.data.attributes}
    assert kinds["radiance:base"] == ("FLOAT4", "POINT") and kinds["rotation"] == ("QUATERNION", "POINT")
    assert kinds["scale"] == kinds["radiance:sh_14"] == ("FLOAT_VECTOR", "POINT")
    command.convert(model, tmp_path / "plain.ply", bake=True)
    plain = read_ply(tmp_path / "plain.ply")
    assert not plain.is_dog.any() and raw.is_dog.any()
    assert np.allclose(column(obj, "scale", 3), np.exp(plain.log_scales), rtol=1e-6)
    assert np.allclose(column(obj, "radiance:base", 4)[:, 3], sigmoid(plain.logit_opacities), rtol=1e-6)
    assert (column(obj, "scale", 3) != np.exp(raw.log_scales)).any(axis=1)[raw.is_dog].mean() > 0.5
    assert np.array_equal(column(obj, "radiance:base", 4)[:, :3], raw.sh_coeffs[:, 0])
    assert (datablocks().objects, datablocks().meshes) == (before.objects + 1, before.meshes)
    assert obj.users_collection and obj.select_get()


def test_a_successor_has_the_properties_and_the_animation_of_the_old_object(scene):
    """Of any data: no native splats are needed."""
    old, parent = bpy.data.objects.new("old", bpy.data.meshes.new("a")), bpy.data.objects.new("parent", None)
    for obj in (old, parent):
        scene.collection.objects.link(obj)
    old.parent, old.rotation_mode, old.display_type = parent, "QUATERNION", "WIRE"
    old.matrix_world, parent.location = PLACED, (1, 2, 3)
    old.visible_camera = old.visible_shadow = False
    old.is_holdout = old.show_in_front = old.lock_location[1] = True
    old.keyframe_insert("location", frame=1)
    animation = old.animation_data
    track = animation.nla_tracks.new()
    strip = track.strips.new("strip", 5, animation.action)
    strip.scale, strip.blend_type, track.mute, track.name = 2.0, "ADD", True, "mine"
    bpy.context.view_layer.update()
    place = old.matrix_world.copy()
    new = successor(old, bpy.data.meshes.new("b"))
    replace_object(old, new)
    bpy.context.view_layer.update()
    assert (new.name, new.data.name, new.parent) == ("old", "a", parent) and np.allclose(new.matrix_world, place)
    assert (new.display_type, new.rotation_mode, new.lock_location[1]) == ("WIRE", "QUATERNION", True)
    assert not new.visible_camera and not new.visible_shadow and new.is_holdout and new.show_in_front
    (track,) = new.animation_data.nla_tracks
    (strip,) = track.strips
    assert track.mute and track.name == "mine" and strip.action == new.animation_data.action
    assert (strip.frame_start, strip.scale, strip.blend_type) == (5, 2, "ADD")


def test_there_and_back_every_bit_and_setting_is_kept(native, scene, model, tmp_path):
    obj, raw = load(model, up_axis="-Y"), read_ply(model)
    obj.matrix_world = PLACED
    obj["mine"], child = 7, bpy.data.objects.new("child", None)
    child.parent = obj
    scene.collection.objects.link(child)
    put_column(obj.data, "own", np.arange(raw.n_splats, dtype=np.float32))
    obj.keyframe_insert("location", frame=1)
    set_input(splat_modifier(obj), "Near Clip", 0.7)
    set_input(splat_modifier(obj), "Show As", "Ellipsoids")
    assert bpy.ops.dogsplat.to_native() == {"FINISHED"}
    cloud = bpy.context.object
    assert cloud.type == "POINTCLOUD" and cloud.name == "dog" and child.parent == cloud and cloud["mine"] == 7
    assert np.allclose(cloud.matrix_world, PLACED, atol=1e-6) and cloud.animation_data.action is not None
    assert np.array_equal(column(cloud, "own", 1)[:, 0], np.arange(raw.n_splats))
    assert_equal(read_cloud(cloud.data), raw)
    assert bpy.ops.dogsplat.to_dog() == {"FINISHED"}
    back = bpy.context.object
    assert back.type == "MESH" and back.name == "dog" and child.parent == back and back["mine"] == 7
    assert_equal(read_attributes(back.data), raw)
    assert np.array_equal(column(back, "own", 1)[:, 0], np.arange(raw.n_splats))
    assert get_input(splat_modifier(back), "Near Clip") == pytest.approx(0.7)
    assert get_input(splat_modifier(back), "Show As") == "Ellipsoids" and get_input(splat_modifier(back), "DoG")
    assert len(bpy.data.objects) == 2 and not bpy.data.pointclouds and len(bpy.data.meshes) == 1
    assert not [a.name for a in back.data.attributes if a.name.startswith("dog:native")]


def test_what_was_edited_on_native_splats_goes_back_with_the_rest(native, model):
    obj, raw = load(model, show_as="NATIVE"), read_ply(model)
    row = int(np.flatnonzero(raw.is_dog)[0])
    scale, base, means = column(obj, "scale", 3), column(obj, "radiance:base", 4), column(obj, "position", 3)
    scale[row] *= (2, 1, 0.5)
    base[row, 3] *= 0.5
    base[row + 1, :3] = 0.25
    means[row + 2] += 1
    for name, values in (("scale", scale), ("radiance:base", base), ("position", means)):
        put_column(obj.data, name, values, "FLOAT4" if values.shape[1] == 4 else None)
    bpy.ops.dogsplat.to_dog()
    found = read_attributes(bpy.context.object.data)
    assert np.allclose(found.log_scales[row], raw.log_scales[row] + np.log([2, 1, 0.5]), atol=1e-5)
    assert sigmoid(found.logit_opacities)[row] == pytest.approx(sigmoid(raw.logit_opacities)[row] / 2, rel=1e-5)
    assert (found.sh_coeffs[row + 1, 0] == 0.25).all() and np.allclose(found.means[row + 2], raw.means[row + 2] + 1)
    assert np.array_equal(found.is_dog, raw.is_dog) and np.array_equal(found.dog_log_scales, raw.dog_log_scales)
    others = np.setdiff1d(np.arange(raw.n_splats), [row, row + 1, row + 2])
    assert_equal(found.select(others), raw.select(others))


def test_crops_are_applied_and_the_original_can_be_kept(native, model):
    obj, raw = load(model), read_ply(model)
    _, target = cropped(obj, "BOX")
    keep = np.abs(local(obj, target, raw.means)).max(axis=1) <= 1
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.dogsplat.to_native(keep_original=True) == {"FINISHED"}
    cloud = bpy.context.object
    assert cloud != obj and cloud.type == "POINTCLOUD" and obj.hide_render and len(obj.data.vertices) == raw.n_splats
    assert_equal(read_cloud(cloud.data), raw.select(keep))


def test_native_splats_of_blenders_own_import_become_ours(native, model):
    """Which have no attributes but 5.3's."""
    raw = read_ply(model)
    obj = load(model, show_as="NATIVE", use_dog=False)
    for attribute in [a.name for a in obj.data.attributes if a.name.startswith("dog:")]:
        obj.data.attributes.remove(obj.data.attributes[attribute])
    for key in list(obj.keys()):
        del obj[key]
    assert bpy.ops.dogsplat.to_dog() == {"FINISHED"}
    found = read_attributes(bpy.context.object.data)
    assert not found.is_dog.any() and splat_modifier(bpy.context.object) is not None
    assert np.allclose(found.log_scales, raw.log_scales, atol=1e-5)
    assert np.array_equal(found.sh_coeffs, raw.sh_coeffs)


def test_exports_and_the_engine_have_native_splats_with_their_dog(native, scene, model, tmp_path):
    """Blender's own export of PLY writes no splats."""
    obj, raw = load(model, show_as="NATIVE"), read_ply(model)
    assert_equal(export(tmp_path / "out.ply"), raw)
    obj.matrix_world = TURN
    place_camera(scene, "dog")
    scene.render.engine = "DOGSPLAT"
    bpy.context.view_layer.update()
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    found = read_ply(order.request["model"])
    assert [of.name for of in order.objects] == ["dog"] and np.array_equal(found.is_dog, raw.is_dog)
    assert np.allclose(found.means, raw.means @ np.array(TURN)[:3, :3].T, atol=1e-4)


def test_without_the_package_dog_cannot_be_baked_and_nothing_is_left(native, model, monkeypatch):
    def missing(command):
        raise RendererError("Mitsuba is not there")

    monkeypatch.setattr(bake, "choose_renderer", missing)
    before = datablocks()
    with pytest.raises(RuntimeError, match="only the package bakes DoG .*Mitsuba is not there"):
        load(model, show_as="NATIVE")
    assert datablocks() == before and not bpy.data.pointclouds
    load(REFERENCES / "plain.ply", show_as="NATIVE")
    obj = load(model)
    with pytest.raises(RuntimeError, match="only the package bakes DoG"):
        bpy.ops.dogsplat.to_native()
    assert bpy.context.object == obj and len(bpy.data.pointclouds) == 1
    assert len(bpy.data.meshes) == 1


def test_the_panel_offers_both_ways(native, model):
    def drawn():
        layout, space = Layout(), SimpleNamespace(shading=None, overlay=None)
        panel = SimpleNamespace(layout=layout, _model=lambda *_: None, _viewport=lambda *_: None)
        context = SimpleNamespace(object=bpy.context.object, scene=bpy.context.scene, space_data=space)
        DOGSPLAT_PT_panel.draw(panel, context)
        return layout.drawn

    load(REFERENCES / "plain.ply")
    assert "dogsplat.to_native" in drawn() and NO_CAMERA not in drawn()
    bpy.ops.dogsplat.to_native()
    assert "dogsplat.to_dog" in drawn() and "dogsplat.to_native" not in drawn()


def test_a_conversion_is_one_step_of_undo(native, model):
    raw = read_ply(model)
    load(model)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.dogsplat.to_native()
    bpy.ops.ed.undo_push(message="to native")
    bpy.ops.ed.undo()
    assert_equal(read_attributes(bpy.data.objects["dog"].data), raw)
    bpy.ops.ed.redo()
    assert bpy.data.objects["dog"].type == "POINTCLOUD"
    assert_equal(read_cloud(bpy.data.objects["dog"].data), raw)
