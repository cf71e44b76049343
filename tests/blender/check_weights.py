"""Weights that are painted, all at once: no work of Python for each splat, of which models have a million."""

import sys

import bpy
import numpy as np
import pytest
from edits import paint
from model_files import load

from blender_addon.editing.stand_in import stand_in_of
from blender_addon.editing.weights import get_weights, put_weights
from blender_addon.files.ply import read_ply, write_ply
from blender_addon.objects.attributes import ERASE
from blender_addon.objects.columns import get_column


def calls(work) -> int:
    """How many functions Python calls meanwhile."""
    found = []
    sys.setprofile(lambda frame, event, argument: found.append(event) if event in ("call", "c_call") else None)
    try:
        work()
    finally:
        sys.setprofile(None)
    return len(found)


def test_painting_begins_and_ends_with_as_many_calls_for_twice_as_many_splats(model, tmp_path):
    raw, found = read_ply(model), []
    for n in (75, 150):
        write_ply(tmp_path / f"{n}.ply", raw.select(np.arange(n)), ())
        obj = load(tmp_path / f"{n}.ply")
        bpy.ops.dogsplat.paint(what="ERASE")
        weights = np.linspace(0.1, 0.9, n, dtype=np.float32)
        for splat, weight in enumerate(weights):
            paint(stand_in_of(obj), np.array([splat]), weight=float(weight))
        counts = [calls(bpy.ops.dogsplat.finish_painting)]
        assert np.array_equal(get_column(obj.data, ERASE, 1)[:, 0], weights)
        counts.append(calls(lambda: bpy.ops.dogsplat.paint(what="ERASE")))
        assert np.array_equal(get_weights(stand_in_of(obj), ERASE)[:, 0], np.repeat(weights, 4))
        found.append(counts)
        bpy.data.batch_remove(list(bpy.data.objects))
    assert np.allclose(*found, atol=30)


def test_weights_are_those_of_one_group_of_the_mesh_itself(scene):
    """Whatever groups there are besides, and whatever modifiers make of the mesh; and nothing stays behind."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=3, y_subdivisions=3)
    obj = bpy.context.object
    first, third = np.linspace(0, 1, 16, dtype=np.float32), np.linspace(1, 0, 16, dtype=np.float32)
    put_weights(obj, "first", first)
    obj.vertex_groups.new(name="empty")
    put_weights(obj, "third", third)
    obj.modifiers.new("more", "SUBSURF")
    before = [len(data) for data in (bpy.data.objects, bpy.data.meshes, bpy.data.node_groups)]
    for name, weights in (("first", first), ("empty", 0 * first), ("third", third), ("missing", 0 * first)):
        assert np.array_equal(get_weights(obj, name)[:, 0], weights)
    assert before == [len(data) for data in (bpy.data.objects, bpy.data.meshes, bpy.data.node_groups)]
    assert [group.name for group in obj.vertex_groups] == ["first", "empty", "third"]
    assert obj.vertex_groups[2].weight(0) == pytest.approx(1) and "third" not in obj.data.attributes
