"""Instances of objects: by nodes on each point of another one, or by a collection."""

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


def only_as_instance(scene: bpy.types.Scene, obj: bpy.types.Object) -> bpy.types.Object:
    """The object, put into a collection that the scene has through an empty alone."""
    collection = bpy.data.collections.new(f"{obj.name} kept")
    for user in obj.users_collection:
        user.objects.unlink(obj)
    collection.objects.link(obj)
    empty = bpy.data.objects.new(f"{obj.name} instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(empty)
    return obj
