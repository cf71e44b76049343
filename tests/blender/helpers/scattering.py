"""Nodes that put an object on each point of another."""

import bpy


def scattering(obj: bpy.types.Object, as_instance: bool = True, realized: bool = False) -> bpy.types.NodeTree:
    """As an instance of the object, or of what its modifiers have made of it; or that as geometry of the other."""
    tree = bpy.data.node_groups.new("scatter", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    kinds = "NodeGroupInput", "GeometryNodeObjectInfo", "GeometryNodeInstanceOnPoints", "NodeGroupOutput"
    points, info, put, end = (tree.nodes.new(kind) for kind in kinds)
    info.inputs["Object"].default_value, info.inputs["As Instance"].default_value = obj, as_instance
    tree.links.new(points.outputs[0], put.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], put.inputs["Instance"])
    made = put.outputs[0]
    if realized:
        realize = tree.nodes.new("GeometryNodeRealizeInstances")
        tree.links.new(made, realize.inputs[0])
        made = realize.outputs[0]
    tree.links.new(made, end.inputs[0])
    return tree
