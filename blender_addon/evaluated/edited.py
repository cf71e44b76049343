"""Splats as the modifiers before the drawing one leave them: what crop, sliders and painting show."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..files.model import Model
from ..nodes.modifier import splat_modifier
from ..objects.attributes import is_native, read_attributes
from ..objects.cloud import read_cloud


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
    drawing, modifiers = splat_modifier(evaluated), evaluated.modifiers
    place = len(modifiers) if drawing is None else modifiers.find(drawing.name)
    own = {name: [getattr(modifier, name) for modifier in modifiers] for name in ("show_viewport", "show_render")}
    for name, values in own.items():  # foreach_set tells nobody: else Blender would evaluate the object once more
        modifiers.foreach_set(name, values[:place] + [False] * (len(values) - place))
    try:
        yield
    finally:
        for name, values in own.items():
            modifiers.foreach_set(name, values)
