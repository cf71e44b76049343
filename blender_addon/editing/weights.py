"""Weights of a vertex group as arrays. Python has them one vertex at a time; operators and nodes have all at once."""

from __future__ import annotations

import bpy
import numpy as np

from ..nodes.paint import WEIGHT, weights_tree
from ..objects.columns import get_column, put_column


def put_weights(obj: bpy.types.Object, name: str, weights: np.ndarray) -> None:
    """Give a mesh object that vertex group, with weights [V]."""
    put_column(obj.data, name, weights)
    obj.data.attributes.active = obj.data.attributes[name]
    with bpy.context.temp_override(object=obj, active_object=obj):
        bpy.ops.geometry.attribute_convert(mode="VERTEX_GROUP")


def get_weights(obj: bpy.types.Object, name: str) -> np.ndarray:
    """[V, 1], zero where a vertex is not in that group, or the mesh object has none."""
    tree, reader = weights_tree(name), bpy.data.objects.new(name, obj.data)  # without the modifiers that obj may have
    reader.modifiers.new(name, "NODES").node_group = tree
    bpy.context.scene.collection.objects.link(reader)
    try:
        return get_column(reader.evaluated_get(bpy.context.evaluated_depsgraph_get()).data, WEIGHT, 1)
    finally:
        bpy.data.objects.remove(reader)
        bpy.data.node_groups.remove(tree)
