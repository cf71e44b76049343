"""Object > Apply, for models: the transform becomes part of the splats."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from ..files.errors import told
from ..files.model import Model
from ..files.transform import mean_scale, transformed
from ..nodes.modifier import scale_limits
from ..objects.attributes import can_edit, own_data, read_attributes, write_attributes
from ..objects.conventions import note_applied
from ..objects.keys import moves_by_itself
from .stand_in import check_painting, finish_painting


class DOGSPLAT_OT_apply_transform(bpy.types.Operator):
    """Make the object's transform part of its splats: positions, orientations, sizes and view-dependent colors"""

    bl_idname = "dogsplat.apply_transform"
    bl_label = "Apply Transform to Splats"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Splats are selected, in object mode."""
        return context.mode == "OBJECT" and any(can_edit(obj) for obj in context.selected_objects)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """All selected models, or after an error none."""
        objects = [obj for obj in context.selected_objects if can_edit(obj)]
        try:
            models = [_moved(obj) for obj in objects]
            for obj in objects:
                check_painting(obj)
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for obj in objects:
            finish_painting(obj)
        for obj, model in zip(objects, models, strict=True):
            own_data(obj)
            matrix = np.array(obj.matrix_world, np.float64)
            write_attributes(obj.data, model)
            scale_limits(obj, mean_scale(matrix[:3, :3]))
            note_applied(obj, matrix)
            _hold_children(obj)
        for obj in sorted(objects, key=_depth):  # whom a matrix is relative to comes first
            _place(context, obj)
        return {"FINISHED"}


def _hold_children(obj: bpy.types.Object) -> None:
    """Let the children of an object, whose own matrix becomes the identity, stay where they are.

    Their keys mean what they did, and those that are hidden, of which Blender does not know where they are, stay too.
    What hangs on vertices stays with these.
    """
    for child in obj.children:
        if child.parent_type not in ("VERTEX", "VERTEX_3"):
            child.matrix_parent_inverse = obj.matrix_world @ child.matrix_parent_inverse


def _place(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Make the matrix of an object to the world the identity.

    Under a parent that is scaled unevenly its own may have to be a shear, which location, rotation and scale cannot
    have; the inverse of the parent can.
    """
    obj.matrix_world = Matrix.Identity(4)
    if obj.parent is None:
        return
    context.view_layer.update()
    own, found = obj.matrix_basis, obj.matrix_world
    if not np.allclose(found, np.eye(4), atol=1e-6) and own.determinant() and found.determinant():
        obj.matrix_parent_inverse = obj.matrix_parent_inverse @ own @ found.inverted() @ own.inverted()


def _depth(obj: bpy.types.Object) -> int:
    """How many parents an object has, theirs included."""
    return 0 if obj.parent is None else 1 + _depth(obj.parent)


def _moved(obj: bpy.types.Object) -> Model:
    """The splats of an object in the space of the world.

    Raises ``ValueError`` that names it, also where it would not stay where it is put, or its splats would not.
    """
    if any(not constraint.mute for constraint in obj.constraints):
        problem = '"{name}": its constraints would move it once more; apply or mute them first'
        raise ValueError(told(problem, name=obj.name))
    if moves_by_itself(obj):
        problem = '"{name}": keys or drivers of its transform would move it once more; delete or mute them first'
        raise ValueError(told(problem, name=obj.name))
    if obj.data.shape_keys is not None:
        problem = '"{name}": its shape keys would take its splats back; apply all of them first'
        raise ValueError(told(problem, name=obj.name))
    try:
        return transformed(read_attributes(obj.data), np.array(obj.matrix_world, np.float64))
    except ValueError as error:
        raise ValueError(told('"{name}": {reason}', name=obj.name, reason=error)) from error
