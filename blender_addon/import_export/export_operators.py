"""Back to files: export of what the selected objects and instances show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..evaluated.edited import later_notes
from ..evaluated.placed import holds_splats, may_repeat_splats, placed_model, placed_splats
from ..files.errors import FileError, told
from ..files.light import in_common_light
from ..files.model import concatenate
from ..files.ply import write_ply
from ..objects.conventions import import_matrix, light_of, metres_of_unit
from ..objects.working_space import converted_notes
from .exported import said_of_all


class DOGSPLAT_OT_export(bpy.types.Operator, ExportHelper):
    """Export the selected splats as one PLY with their DoG data. Splats that nobody changed keep their bits"""

    bl_idname = "export_scene.dogsplat"
    bl_label = "Export DoG Splat"
    bl_options = {"PRESET"}

    filename_ext = ".ply"
    filter_glob: StringProperty(default="*.ply", options={"HIDDEN"})
    space: EnumProperty(name="Coordinates", default="FILE", items=(
        ("FILE", "Of the File", "Undo the up axis and scale of the import, but keep later movements"),
        ("WORLD", "Of the Scene", "As the splats stand in Blender, z up"),
    ))  # fmt: skip
    hidden: BoolProperty(
        name="Hidden Splats",
        description="Ignore crop, limits and painting. If off, only what they show is written",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Something to export is selected."""
        return any(holds_splats(obj) or may_repeat_splats(obj) for obj in context.selected_objects)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Several objects become one model, in the coordinates of the first one's file."""
        if context.mode == "EDIT_MESH":  # attributes cannot be read there
            bpy.ops.object.mode_set(mode="OBJECT")
            try:
                return self.execute(context)
            finally:
                bpy.ops.object.mode_set(mode="EDIT")
        chosen = set(context.selected_objects)
        depsgraph = context.evaluated_depsgraph_get()
        placed = list(placed_splats(depsgraph, chosen.__contains__))
        if not placed:
            hidden = "the selected splats are hidden in this view layer; show them first"
            none = "what is selected shows no splats; select some, or what makes instances of them"
            self.report({"ERROR"}, told(hidden if any(map(holds_splats, chosen)) else none))
            return {"CANCELLED"}
        objects, path = [obj for obj, _, _ in placed], Path(bpy.path.abspath(self.filepath))
        first = context.object if context.object in objects else objects[0]
        try:
            target = np.linalg.inv(import_matrix(first)) if self.space == "FILE" else np.eye(4)
            models = [placed_model(obj, depsgraph, target @ matrix, self.hidden) for obj, matrix, _ in placed]
            models, light = in_common_light(models, [light_of(obj) for obj in objects])
            model = concatenate(models)
            if model.n_splats == 0:
                remedy = "select a model that has some, or open its crop"
                raise FileError(path, "there is no splat to export", remedy)
            said = said_of_all(first, objects, target)
            if self.space == "WORLD":
                said = replace(said, up=(0.0, 0.0, 1.0), scale=metres_of_unit(context.scene))
            write_ply(path, model, said.lit(light).comments)
        except ValueError as error:  # FileError too
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, told("{count:,} splats exported", count=model.n_splats))
        later = [note for obj in dict.fromkeys(objects) for note in later_notes(obj, depsgraph)]
        for note in converted_notes(objects) + later:
            self.report({"WARNING"}, note)
        return {"FINISHED"}
