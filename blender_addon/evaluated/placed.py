"""Splats where they stand: objects, and instances of them, by collections, points, faces or nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import bpy
import numpy as np

from ..files.errors import told
from ..files.model import Model
from ..files.transform import transformed
from ..nodes.material import draws_splats
from ..objects.attributes import has_splats, is_native, read_attributes
from ..objects.cloud import read_cloud
from .edited import edited_model
from .visible import all_objects


def holds_splats(obj: bpy.types.Object) -> bool:
    """Whether an object is splats, or an instance of a collection with splats, or with such instances."""
    return any(map(has_splats, _with_instanced([obj])))


def objects_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of a scene, then those that are there only as instances of collections, or of those in these."""
    return _with_instanced(scene.objects)


def _with_instanced(objects: Iterable[bpy.types.Object]) -> list[bpy.types.Object]:
    found = dict.fromkeys(objects)
    waiting = list(found)
    while waiting:
        obj = waiting.pop()
        if obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
            new = [inner for inner in obj.instance_collection.all_objects if inner not in found]
            found |= dict.fromkeys(new)
            waiting += new
    return list(found)


def placed_splats(
    depsgraph: bpy.types.Depsgraph, wanted: Callable[[bpy.types.Object], bool] = lambda obj: True
) -> Iterator[tuple[bpy.types.Object, np.ndarray, bpy.types.Object]]:
    """(object with splats, its matrix to the world [4, 4], owner), instances after all objects of their own.

    The owner is the object itself, or that which makes the instance; ``wanted`` takes it.
    """
    own = [obj.original for obj in depsgraph.objects]
    for obj in own:
        if has_splats(obj) and wanted(obj):
            yield obj, np.array(obj.evaluated_get(depsgraph).matrix_world, np.float64), obj
    if not any(may_repeat_splats(obj) and wanted(obj) for obj in _originals(depsgraph)):
        return
    for instance in depsgraph.object_instances:
        if not instance.is_instance or not has_splats(instance.object.original):
            continue
        obj, parent = instance.object.original, instance.parent.original
        drawn = instance.object.data.as_pointer() != obj.evaluated_get(depsgraph).data.as_pointer()
        if obj != parent and not drawn and wanted(parent):
            yield obj, np.array(instance.matrix_world, np.float64), parent


def copied_drawings(depsgraph: bpy.types.Depsgraph, wanted: Callable[[bpy.types.Object], bool]) -> list[str]:
    """Names of the objects whose nodes take over what draws splats, for the view of another camera or as ellipsoids.

    Nothing there says which splats these were.
    """
    if not any(_has_nodes(obj) and wanted(obj) for obj in _originals(depsgraph)):
        return []
    found = {}
    for instance in depsgraph.object_instances:
        obj = instance.object
        owner = (instance.parent if instance.is_instance else obj).original
        if obj.original == owner and owner.name not in found and not has_splats(owner) and wanted(owner):
            if any(map(draws_splats, getattr(obj.data, "materials", ()))):
                found[owner.name] = None
    return list(found)


def _originals(depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Object]:
    return [obj.original for obj in all_objects(depsgraph)]


def _has_nodes(obj: bpy.types.Object) -> bool:
    return not has_splats(obj) and any(modifier.type == "NODES" for modifier in obj.modifiers)


def may_repeat_splats(obj: bpy.types.Object) -> bool:
    """Whether splats may be among the instances that it makes; of those of nodes nobody knows without a look."""
    return any(
        inner.instance_type not in ("NONE", "COLLECTION")
        or _has_nodes(inner)
        or any(system.settings.render_type in ("OBJECT", "COLLECTION") for system in inner.particle_systems)
        or (inner != obj and has_splats(inner))
        for inner in _with_instanced([obj])
    )


def placed_model(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, matrix: np.ndarray, hidden: bool = False
) -> Model:
    """The splats of an object, moved by a [4, 4] matrix; with ``hidden`` as if nothing edited them.

    Raises ``ValueError`` for an object without the attributes or with a transform that flattens them.
    """
    try:
        data = obj.original.data
        whole = read_cloud if is_native(obj.original) else read_attributes
        model = whole(data) if hidden else edited_model(obj, depsgraph)
    except ValueError as error:
        raise ValueError(told('"{name}": {reason}', name=obj.name, reason=error)) from error
    return moved_model(model, matrix, obj.name)


def moved_model(model: Model, matrix: np.ndarray, name: str) -> Model:
    """The splats of an object of that name, moved.

    Raises ``ValueError`` for a transform that flattens them, and for numbers that are not finite.
    """
    try:
        moved = transformed(model, matrix)
    except ValueError as error:
        raise ValueError(told('"{name}": {reason}', name=name, reason=error)) from error
    if n := np.count_nonzero(~moved.is_finite):
        problem = '"{name}": {n:,} of its splats have values that are not finite; delete them'
        raise ValueError(told(problem, name=name, n=n))
    return moved
