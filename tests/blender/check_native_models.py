"""Convert to Native and back as users do it: trained models, with all that an object of a scene can have.

As in ``check_native.py``, a property stands in for the type that Blender 5.3 has.
"""

import shlex

import addon_utils
import bpy
import numpy as np
import pytest
from edits import PLACED, cropped, paint, shown
from model_files import load
from model_values import assert_equal
from package_command import COMMAND
from references import REFERENCES

from blender_addon.editing.stand_in import stand_in_of
from blender_addon.files.model import sigmoid
from blender_addon.files.ply import read_ply, write_ply
from blender_addon.nodes.modifier import edit_modifiers, get_input, set_input, splat_modifier
from blender_addon.objects.attributes import read_attributes
from blender_addon.objects.cloud import read_cloud
from blender_addon.objects.columns import get_column
from blender_addon.objects.conventions import light_of, said_of


@pytest.fixture
def in_preferences(native):
    """The command of the package stands where users name it, which the package in this Python does not replace."""
    addon_utils.enable("blender_addon", default_set=True)
    bpy.context.preferences.addons["blender_addon"].preferences.command = shlex.join(COMMAND)


def drawn(obj):
    """Scales and opacities as Blender draws them."""
    return get_column(obj.data, "scale", 3), get_column(obj.data, "radiance:base", 4)[:, 3]


def test_a_trained_dog_model_is_baked_by_the_command_with_its_edits(native, in_preferences, shared, command, tmp_path):
    """Oracle: the command, on what is shown; and the shown model comes back with all of its bits."""
    obj = load(REFERENCES / "fox_dog.ply", up_axis="-Y", scale=2.0)
    assert read_attributes(obj.data).is_dog.mean() > 0.5
    cropped(obj, "SPHERE")
    bpy.context.view_layer.objects.active = obj
    bpy.ops.dogsplat.add_limits()
    set_input(edit_modifiers(obj)[-1], "Maximum Count", 500)
    bpy.ops.dogsplat.paint(what="TINT")
    paint(stand_in_of(obj), np.arange(0, 1000, 3), color=(1.0, 0.4, 0.2, 0.5))
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    expected, place = shown(obj), obj.matrix_world.copy()
    assert 50 < expected.n_splats <= 500 and expected.is_dog.any()
    assert bpy.ops.dogsplat.to_native() == {"FINISHED"}
    cloud = bpy.context.object
    assert cloud.type == "POINTCLOUD" and cloud.name == "fox_dog" and np.allclose(cloud.matrix_world, place)
    write_ply(tmp_path / "shown.ply", expected)
    command.convert(tmp_path / "shown.ply", tmp_path / "plain.ply", bake=True)
    plain, (scale, opacity) = read_ply(tmp_path / "plain.ply"), drawn(cloud)
    assert np.allclose(scale, np.exp(plain.log_scales), rtol=1e-5)
    assert np.allclose(opacity, sigmoid(plain.logit_opacities), rtol=1e-5)
    assert_equal(read_cloud(cloud.data), expected)
    assert bpy.ops.dogsplat.to_dog() == {"FINISHED"}
    back = bpy.context.object
    assert_equal(read_attributes(back.data), expected)
    assert {other.type for other in bpy.data.objects} == {"EMPTY", "MESH"}  # the crop object stays
    bpy.ops.dogsplat.paint(what="TINT")
    assert_equal(shown(back), expected)  # and no tint is there twice


def test_a_large_model_without_dog_goes_there_and_back(native, shared):
    """125,000 splats of SH degree 2, for which no package is asked."""
    obj, raw = load(REFERENCES / "playbot.ply", up_axis="-Y"), read_ply(REFERENCES / "playbot.ply")
    obj.matrix_world = PLACED
    assert bpy.ops.dogsplat.to_native() == {"FINISHED"}
    cloud = bpy.context.object
    scale, opacity = drawn(cloud)
    assert np.array_equal(scale, np.exp(raw.log_scales)) and np.array_equal(opacity, sigmoid(raw.logit_opacities))
    assert bpy.ops.dogsplat.to_dog() == {"FINISHED"}
    assert_equal(read_attributes(bpy.context.object.data), raw)


ATTRIBUTES = {
    "FLOAT": ("value", 0.5), "FLOAT2": ("vector", [0.25, 2.0]), "FLOAT_VECTOR": ("vector", [1.0, 2.0, 3.0]),
    "FLOAT4": ("vector", [1.0, -2.0, 3.0, 0.5]), "FLOAT_COLOR": ("color", [0.5, -0.25, 0.125, 1.0]),
    "BYTE_COLOR": ("color", [1.0, 0.0, 0.0, 1.0]), "QUATERNION": ("value", [0.0, 1.0, 0.0, 0.0]),
    "FLOAT4X4": ("value", np.arange(16.0).reshape(4, 4).tolist()), "INT": ("value", 7), "INT8": ("value", -3),
    "BOOLEAN": ("value", True), "INT16_2D": ("value", [3, -4]), "INT32_2D": ("value", [3, -4]),
}  # fmt: skip


def test_attributes_of_every_type_come_along(native, model):
    """But for strings, which no node and no tool of Blender makes for points."""
    obj, expected = load(model), {}
    kinds = [item.identifier for item in bpy.types.Attribute.bl_rna.properties["data_type"].enum_items]
    assert set(kinds) - set(ATTRIBUTES) == {"STRING"}
    for kind in kinds:
        if kind in ATTRIBUTES:
            field, value = ATTRIBUTES[kind]
            point = obj.data.attributes.new(f"my {kind}", kind, "POINT").data[5]
            setattr(point, field, value)
            expected[kind] = np.array(getattr(point, field))
    bpy.ops.dogsplat.to_native()
    bpy.ops.dogsplat.to_dog()
    for kind, value in expected.items():
        attribute = bpy.context.object.data.attributes.get(f"my {kind}")
        assert attribute is not None and (attribute.data_type, attribute.domain) == (kind, "POINT"), kind
        assert value.any() and np.array_equal(getattr(attribute.data[5], ATTRIBUTES[kind][0]), value), kind
        assert not np.array_equal(getattr(attribute.data[6], ATTRIBUTES[kind][0]), value), kind


@pytest.mark.parametrize("name", ["says.ply", "linear.ply"])
def test_what_a_file_says_of_its_model_comes_along(native, name):
    obj = load(REFERENCES / name)
    said, light = said_of(obj), light_of(obj)
    for convert in (bpy.ops.dogsplat.to_native, bpy.ops.dogsplat.to_dog):
        assert convert() == {"FINISHED"}
        assert (said_of(bpy.context.object), light_of(bpy.context.object)) == (said, light)
        assert said.antialiased or light.linear


def test_several_objects_that_share_their_splats_are_converted_in_their_own_places(native, scene, model):
    """In collections of their own, the active one in two; who points at one points at the new one."""
    raw, first = read_ply(model), load(model)
    bpy.ops.object.duplicate(linked=True)
    second = bpy.context.object
    second.matrix_world = PLACED
    collections = [bpy.data.collections.new(name) for name in ("one", "two")]
    for collection in collections:
        scene.collection.children.link(collection)
        collection.objects.link(second)
    scene.collection.objects.unlink(second)
    set_input(splat_modifier(second), "DoG", False)
    empty = bpy.data.objects.new("empty", None)
    scene.collection.objects.link(empty)
    empty.constraints.new("COPY_LOCATION").target = second
    first.select_set(True)
    names = first.name, second.name
    assert bpy.ops.dogsplat.to_native() == {"FINISHED"}
    first, second = (bpy.data.objects[name] for name in names)
    assert bpy.context.object == second == empty.constraints[0].target and first.select_get()
    assert {c.name for c in second.users_collection} == {"one", "two"}
    assert np.allclose(second.matrix_world, PLACED, atol=1e-6)
    scales = [drawn(obj)[0] for obj in (first, second)]
    assert np.array_equal(scales[1], np.exp(raw.log_scales)) and not np.array_equal(*scales)
    assert bpy.ops.dogsplat.to_dog() == {"FINISHED"}
    first, second = (bpy.data.objects[name] for name in names)
    for obj in (first, second):
        assert_equal(read_attributes(obj.data), raw)
    assert get_input(splat_modifier(first), "DoG") and not get_input(splat_modifier(second), "DoG")
    assert len(bpy.data.objects) == 3 and len(bpy.data.meshes) == 2 and not bpy.data.pointclouds


def test_a_model_is_converted_while_its_stand_in_is_the_active_object(native, model):
    """As it is after a stroke, when somebody adds the model to the selection."""
    obj, raw = load(model), read_ply(model)
    bpy.ops.dogsplat.paint(what="ERASE")
    paint(stand_in_of(obj), np.arange(40), weight=1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.select_set(True)
    assert bpy.context.object == stand_in_of(obj)
    assert bpy.ops.dogsplat.to_native() == {"FINISHED"}
    (cloud,) = bpy.data.objects
    assert cloud.type == "POINTCLOUD" and cloud.select_get()
    assert_equal(read_cloud(cloud.data), raw.select(np.arange(40, raw.n_splats)))
