"""The splats that are shown, as meshes of their own: what an edit becomes when it is applied."""

from __future__ import annotations

import bpy

from ..evaluated.edited import edited_mesh
from ..files.errors import told
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
    return mesh


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
