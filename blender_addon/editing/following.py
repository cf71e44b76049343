"""Splats follow their points: turned and scaled as Blender's own tools moved the vertices.

Apply Transform, Join, and turning or scaling in edit mode change the positions of vertices and nothing else. So every
splat also has the position at which its other attributes were right. Where the two differ by one linear transform,
orientations, sizes and spherical harmonics follow it. So do the limits of a model that was scaled as a whole.
"""

from __future__ import annotations

from dataclasses import fields

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..files.model import Model
from ..files.motion import is_rounding, is_shift, motions
from ..files.transform import mean_scale, transformed
from ..nodes.modifier import scale_limits
from ..objects.attributes import get_positions, is_splats, put_positions, read_attributes, write_attributes
from ..preferences import follows_vertices


def follow_vertices(mesh: bpy.types.Mesh) -> float:
    """Put the splats of a mesh right whose vertices were moved since then; by how much all of it was scaled, else 1."""
    found = get_positions(mesh)
    if found is None or np.array_equal(*found):
        return 1.0
    before, after = found
    turned: list[tuple[np.ndarray, np.ndarray]] = []
    for rows, matrix in motions(before, after):
        if is_rounding(before[rows], after[rows]):
            after[rows] = before[rows]
        elif not is_shift(matrix):
            turned.append((rows, matrix))
    put_positions(mesh, after)
    if turned:
        model = read_attributes(mesh)
        for rows, matrix in turned:
            _replace(model, rows, transformed(model.select(rows), matrix))
        model.means = after
        write_attributes(mesh, model)
    whole = len(turned) == 1 and len(turned[0][0]) == len(after)
    return mean_scale(turned[0][1][:3, :3]) if whole else 1.0


def _replace(model: Model, rows: np.ndarray, part: Model) -> None:
    for field in fields(model):
        values = getattr(model, field.name)
        values[rows] = getattr(part, field.name)


@persistent
def follow(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """After every change, for the objects whose geometry it was."""
    if not follows_vertices(bpy.context):
        return
    changed = [update.id.original for update in depsgraph.updates
               if update.is_updated_geometry and isinstance(update.id, bpy.types.Object)]  # fmt: skip
    for obj in changed:
        if is_splats(obj) and obj.mode == "OBJECT" and obj.data.library is None:
            factor = follow_vertices(obj.data)
            if factor != 1:
                for user in bpy.data.objects:
                    if user.data == obj.data and user.library is None:
                        scale_limits(user, factor)
