"""Splats as the modifiers before the drawing one leave them: what crop, sliders and painting show."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..files.model import Model
from ..native.cloud import read_cloud
from ..nodes.modifier import splat_modifier
from .attributes import is_native, read_attributes


def edited_model(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Model:
    """The splats of an object that are shown, in its own space. Raises ``ValueError`` as ``read_attributes``."""
    evaluated = obj.evaluated_get(depsgraph)
    if is_native(evaluated):
        return read_cloud(evaluated.data)
    with _not_drawn(evaluated):
        mesh = evaluated.to_mesh(preserve_all_data_layers=True, depsgraph=depsgraph)
        try:
            if not mesh.vertices:  # nor attributes
                return read_attributes(obj.original.data).select(np.zeros(0, int))
            return read_attributes(mesh)
        finally:
            evaluated.to_mesh_clear()


def edited_mesh(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bpy.types.Mesh:
    """A new mesh in the file with all attributes of the splats that are shown."""
    evaluated = obj.evaluated_get(depsgraph)
    with _not_drawn(evaluated):
        mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    mesh.materials.clear()
    return mesh


@contextmanager
def _not_drawn(evaluated: bpy.types.Object) -> Iterator[None]:
    """Leave the drawing modifier and those after it out of the evaluations meanwhile.

    Only the evaluated copy of the object is told so, which nothing else sees: Blender evaluates the modifiers anew for
    a mesh that shall have all of its data layers.
    """
    drawing = splat_modifier(evaluated)
    place = len(evaluated.modifiers) if drawing is None else evaluated.modifiers.find(drawing.name)
    left_out = [(m, m.show_viewport, m.show_render) for m in evaluated.modifiers[place:]]
    for modifier, _, _ in left_out:
        modifier.show_viewport = modifier.show_render = False
    try:
        yield
    finally:
        for modifier, in_viewport, in_render in left_out:
            modifier.show_viewport, modifier.show_render = in_viewport, in_render
