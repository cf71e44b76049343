"""The splats that are shown, as meshes of their own: what an edit becomes when it is applied."""

from __future__ import annotations

import bpy

from ..evaluated.edited import edited_mesh
from ..files.errors import told
from ..nodes.modifier import edit_modifiers, get_input, splat_modifier
from ..nodes.paint import NAME as PAINT
from ..objects.attributes import ERASE, TINT, spread_ranks
from .stand_in import check_painting, keep_painted


def applied_mesh(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bpy.types.Mesh:
    """A new mesh of what the modifiers show of an object, which stays as it is.

    Raises ``ValueError`` where nothing is left, or nobody knows what is painted.
    """
    check_painting(obj)
    mesh = edited_mesh(obj, depsgraph)
    if not mesh.vertices:
        bpy.data.meshes.remove(mesh)
        raise ValueError(told('"{name}": no splat is left; open its crop or its limits', name=obj.name))
    keep_painted(obj, mesh)
    _forget_applied(obj, mesh)
    spread_ranks(mesh)
    return mesh


def applied_modifiers(obj: bpy.types.Object) -> list[bpy.types.Modifier]:
    """Those that become part of such a mesh: all in front of the drawing one that are on, ours or not."""
    drawing = splat_modifier(obj)
    place = len(obj.modifiers) if drawing is None else obj.modifiers.find(drawing.name)
    return [modifier for modifier in obj.modifiers[:place] if modifier.show_viewport]


def _forget_applied(obj: bpy.types.Object, mesh: bpy.types.Mesh) -> None:
    """Remove from a mesh of the splats that are shown what was painted to show them so.

    Otherwise painting, which goes on from there, would tint the colours once more. What a modifier is told to ignore,
    or is painted for one that is off, stays.
    """
    applied = applied_modifiers(obj)
    for modifier in [modifier for modifier in edit_modifiers(obj, PAINT) if modifier in applied]:
        for name in (ERASE, TINT):  # the switches of the modifier have the names of the attributes
            if name in mesh.attributes and get_input(modifier, name):
                mesh.attributes.remove(mesh.attributes[name])


def applied_meshes(objects: list[bpy.types.Object], depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Mesh]:
    """One for each object; after an error none. Raises ``ValueError``."""
    made: list[bpy.types.Mesh] = []
    try:
        for obj in objects:
            made.append(applied_mesh(obj, depsgraph))
    except ValueError:
        for mesh in made:
            bpy.data.meshes.remove(mesh)
        raise
    return made
