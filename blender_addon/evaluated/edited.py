"""Splats as the modifiers before the drawing one leave them: what crop, sliders and painting show."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..files.errors import told
from ..files.model import Model
from ..nodes.modifier import splat_modifier
from ..objects.attributes import is_native, read_attributes
from ..objects.cloud import read_cloud

# Blender puts new modifiers there
LATER = '"{name}": its modifier "{modifier}" comes after the one that draws and changes no splats; move it in front'


def edited_model(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Model:
    """The splats of an object that are shown, in its own space. Raises ``ValueError`` as ``read_attributes``."""
    evaluated = obj.evaluated_get(depsgraph)
    if is_native(evaluated):
        return read_cloud(evaluated.data)
    with _not_drawn(evaluated, depsgraph):
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
    with _not_drawn(evaluated, depsgraph):
        mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    mesh.materials.clear()
    return mesh


def later_notes(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> list[str]:
    """A line about each modifier after that which draws, whose quads it may change, but never splats."""
    modifiers = obj.evaluated_get(depsgraph).modifiers
    drawing, switch = splat_modifier(obj), _switch(depsgraph)
    later = modifiers[modifiers.find(drawing.name) + 1 :] if drawing else ()
    return [told(LATER, name=obj.name, modifier=each.name) for each in later if getattr(each, switch)]


def _switch(depsgraph: bpy.types.Depsgraph) -> str:
    """The property of modifiers that says whether a graph has them."""
    return "show_render" if depsgraph.mode == "RENDER" else "show_viewport"


@contextmanager
def _not_drawn(evaluated: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """Leave the drawing modifier and those after it out of the evaluations meanwhile.

    Only the evaluated copy of the object is told so, which nothing else sees: Blender evaluates the modifiers anew for
    a mesh that shall have all of its data layers.
    """
    drawing, modifiers = splat_modifier(evaluated), evaluated.modifiers
    place = len(modifiers) if drawing is None else modifiers.find(drawing.name)
    switch = _switch(depsgraph)
    own = [getattr(modifier, switch) for modifier in modifiers]
    _set(modifiers, switch, own[:place] + [False] * (len(own) - place))
    try:
        yield
    finally:
        _set(modifiers, switch, own)


def _set(modifiers: bpy.types.ObjectModifiers, switch: str, values: list[bool]) -> None:
    """Without a word to Blender, which would evaluate the object once more, as far as that can be."""
    modifiers.foreach_set(switch, values)
    for modifier, value in zip(modifiers, values, strict=True):
        if getattr(modifier, switch) != value:  # of a linked file, foreach_set leaves show_render as it is
            setattr(modifier, switch, value)
