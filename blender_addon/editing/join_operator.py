"""Object > Join, for models: what is hidden stays away, and what stood elsewhere is turned on the way."""

from __future__ import annotations

import bpy
import numpy as np

from ..files.errors import told
from ..files.linear_map import check_regular
from ..objects.attributes import can_edit
from ..objects.columns import get_column, put_column
from ..objects.conventions import DOG_COUNT, light_of
from .apply_operator import apply_edits
from .following import follow_vertices, not_followed

PART = "dog:part"  # which of the models that are joined a splat was of


class DOGSPLAT_OT_join(bpy.types.Operator):
    """Join the selected models into the active one, with their edits applied. Missing SH bands become zero"""

    bl_idname = "dogsplat.join"
    bl_label = "Join Splats"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Several models are selected, one of them active."""
        models = _models(context)
        return context.mode == "OBJECT" and len(models) > 1 and context.object in models

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Blender's own Join keeps all attributes; afterwards the splats follow where their points went."""
        active, models = context.object, _models(context)
        try:
            for obj in [active, *models]:  # what the active one flattens has no place in it
                check_regular(np.array(obj.matrix_world, np.float64)[:3, :3])
            to_active = np.linalg.inv(np.array(active.matrix_world, np.float64))
            moves = []
            for obj in models:
                moves.append(to_active @ np.array(obj.matrix_world, np.float64))
                check_regular(moves[-1][:3, :3])
        except ValueError as error:
            self.report({"ERROR"}, told('"{name}": {reason}', name=obj.name, reason=error))
            return {"CANCELLED"}
        if len({light_of(obj).linear for obj in models}) > 1:
            text = told("some of these models hold radiance, others sRGB values; join those of one kind")
            self.report({"ERROR"}, text)
            return {"CANCELLED"}
        try:
            apply_edits(models, context.evaluated_depsgraph_get())
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for obj in context.selected_objects:
            obj.select_set(obj in models)
        dog = sum(int(obj.get(DOG_COUNT, 0)) for obj in models)
        for k, obj in enumerate(models):
            put_column(obj.data, PART, np.full(len(obj.data.vertices), k, np.int32))
        with not_followed():
            bpy.ops.object.join()
        active[DOG_COUNT] = dog
        part = get_column(active.data, PART, 1)[:, 0]
        active.data.attributes.remove(active.data.attributes[PART])
        follow_vertices(active.data, [(np.flatnonzero(part == k), move) for k, move in enumerate(moves)])
        return {"FINISHED"}


def _models(context: bpy.types.Context) -> list[bpy.types.Object]:
    return [obj for obj in context.selected_objects if can_edit(obj)]
