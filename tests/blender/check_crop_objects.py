"""Crop objects of unusual places: mirrored, beside mirrored models, flat, or of no size at all."""

import bpy
import numpy as np
import pytest
from edits import cropped, local, shown
from model_files import load
from model_values import assert_equal

from blender_addon.objects.attributes import put_positions, read_attributes


@pytest.mark.parametrize("of_model", [1, -1])
@pytest.mark.parametrize("of_crop", [1, -1])
def test_a_mirrored_mesh_crops_as_its_mirror_image(model, of_model, of_crop):
    """And a mesh that crops a mirrored model."""
    obj = load(model)
    obj.scale.x = of_model
    raw = read_attributes(obj.data)
    _, target = cropped(obj, "MESH")
    target.scale.x *= of_crop
    obj.update_tag()
    assert_equal(shown(obj), raw.select(np.abs(local(obj, target, raw.means)).max(axis=1) <= 1))


@pytest.mark.parametrize("shape", ["BOX", "SPHERE", "MESH"])
@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 1, 0), (0, 1, 1)])
@pytest.mark.parametrize("invert", [False, True])
def test_nothing_is_inside_of_a_crop_without_room(model, shape, scale, invert):
    """Also of a model near the origin, where it is seen as by an object that is not placed at all."""
    obj = load(model)
    put_positions(obj.data, small(obj))
    _, target = cropped(obj, shape, invert=invert)
    target.scale = scale
    assert shown(obj).n_splats == (len(obj.data.vertices) if invert else 0)


@pytest.mark.parametrize("shape", ["BOX", "SPHERE", "MESH"])
def test_a_model_without_splats_gets_a_crop_as_any_other(model, shape):
    obj = load(model)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    _, target = cropped(obj, shape)
    assert shown(obj).n_splats == 0 and min(target.scale) > 0.1


def small(obj) -> np.ndarray:
    """Positions of the splats of a model, all within a unit of the origin."""
    means = read_attributes(obj.data).means
    return (means / np.abs(means).max()).astype(np.float32)
