"""Splats follow their points: turned and scaled as Blender's own tools moved the vertices.

Apply Transform, Join, and turning or scaling in edit mode change the positions of vertices and nothing else. So every
splat also has the position at which its other attributes were right. Where the two differ by one linear transform,
orientations, sizes and spherical harmonics follow it. So do, where all of a model went through it, its limits and the
place of the cameras of its file.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..files.model import Model
from ..files.motion import is_rounding, is_shift, motions
from ..files.transform import mean_scale, transformed
from ..nodes.modifier import scale_limits
from ..objects.attributes import (
    get_positions,
    is_splats,
    put_positions,
    read_attributes,
    spread_ranks,
    write_attributes,
)
from ..objects.conventions import note_applied
from ..preferences import follows_vertices

Moves = Sequence[tuple[np.ndarray, np.ndarray]]  # rows, and the [4, 4] that they went through


class _Handler:
    """Whether the handler leaves splats alone."""

    rests = False


@contextmanager
def not_followed() -> Iterator[None]:
    """For what knows better how vertices move than they tell: few of them tell no turn."""
    _Handler.rests = True
    try:
        yield
    finally:
        _Handler.rests = False


def follow_vertices(mesh: bpy.types.Mesh, moves: Moves | None = None) -> np.ndarray:
    """Put the splats of a mesh right whose vertices were moved since then; the [4, 4] that all of it went through, or
    the identity. ``moves``: how they were moved, where that is known."""
    found = get_positions(mesh)
    if found is None or np.array_equal(*found, equal_nan=True):
        return np.eye(4)
    before, after = found
    turned: list[tuple[np.ndarray, np.ndarray]] = []
    whole = np.eye(4)
    for rows, matrix in motions(before, after) if moves is None else moves:
        if is_rounding(before[rows], after[rows]):
            after[rows] = before[rows]
            continue
        if not is_shift(matrix):
            turned.append((rows, matrix))
        if len(rows) == len(after):
            whole = matrix
    put_positions(mesh, after)
    if turned:
        model = read_attributes(mesh)
        for rows, matrix in turned:
            _replace(model, rows, transformed(model.select(rows), matrix))
        model.means = after
        write_attributes(mesh, model)
    return whole


def _replace(model: Model, rows: np.ndarray, part: Model) -> None:
    for field in fields(model):
        values = getattr(model, field.name)
        values[rows] = getattr(part, field.name)


@persistent
def follow(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """After every change, for the objects whose geometry it was."""
    if _Handler.rests:
        return
    follows = follows_vertices(bpy.context)
    changed = [update.id.original for update in depsgraph.updates
               if update.is_updated_geometry and isinstance(update.id, bpy.types.Object)]  # fmt: skip
    for obj in changed:
        # Edit mode keeps attributes elsewhere, also for those that only share the data
        if is_splats(obj) and obj.mode == "OBJECT" and obj.data.library is None and not obj.data.is_editmode:
            spread_ranks(obj.data)  # some may be deleted, doubled or joined
            matrix = follow_vertices(obj.data) if follows else np.eye(4)
            if np.array_equal(matrix, np.eye(4)):
                continue
            for user in (other for other in bpy.data.objects if other.data == obj.data and other.library is None):
                note_applied(user, matrix)
                if not is_shift(matrix):  # limits keep their bits then
                    scale_limits(user, mean_scale(matrix[:3, :3]))
