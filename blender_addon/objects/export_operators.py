"""Back to files: export of edited splats, and transforms made part of the splats."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper
from mathutils import Matrix

from ..files.errors import FileError
from ..files.model import Model, concatenate
from ..files.ply import write_ply
from ..files.transform import transformed
from .attributes import is_splats, read_attributes, write_attributes
from .conventions import import_matrix


def selected_splats(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Selected objects that hold splats."""
    return [obj for obj in context.selected_objects if is_splats(obj)]


def model_of(obj: bpy.types.Object, to_target: np.ndarray) -> Model:
    """The splats of an object, moved by ``to_target`` [4, 4] after its own transform.

    Raises ``ValueError`` for an object without the attributes or with a transform that splats cannot follow.
    """
    matrix = to_target @ np.array(obj.matrix_world, np.float64)
    try:
        return transformed(read_attributes(obj.data), matrix)
    except ValueError as error:
        raise ValueError(f'"{obj.name}": {error}') from error


class DOGSPLAT_OT_export(bpy.types.Operator, ExportHelper):
    """Export the selected splats as one PLY with its DoG data; what nobody changed keeps the bits of its file"""

    bl_idname = "export_scene.dogsplat"
    bl_label = "Export DoG Splat"
    bl_options = {"PRESET"}

    filename_ext = ".ply"
    filter_glob: StringProperty(default="*.ply", options={"HIDDEN"})
    space: EnumProperty(name="Coordinates", default="FILE", items=(
        ("FILE", "Of the File", "Undo the up axis and scale of the import, keep what was moved since then"),
        ("WORLD", "Of the Scene", "As the splats stand in Blender, z up"),
    ))  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Something to export is selected."""
        return bool(selected_splats(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Several objects become one model, in the coordinates of the first one's file."""
        if context.mode == "EDIT_MESH":  # attributes cannot be read there
            bpy.ops.object.mode_set(mode="OBJECT")
            try:
                return self.execute(context)
            finally:
                bpy.ops.object.mode_set(mode="EDIT")
        objects = selected_splats(context)
        first = context.object if context.object in objects else objects[0]
        target = np.linalg.inv(import_matrix(first)) if self.space == "FILE" else np.eye(4)
        try:
            model = concatenate([model_of(obj, target) for obj in objects])
            if model.n_splats == 0:
                raise FileError(self.filepath, "there is no splat to export", "select a model that has some")
            write_ply(Path(self.filepath), model)
        except ValueError as error:  # FileError too
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{model.n_splats:,} splats exported")
        return {"FINISHED"}


class DOGSPLAT_OT_apply_transform(bpy.types.Operator):
    """Make the object's transform part of its splats: positions, orientations, sizes and view-dependent colours"""

    bl_idname = "dogsplat.apply_transform"
    bl_label = "Apply Transform to Splats"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Splats are selected, in object mode."""
        return context.mode == "OBJECT" and bool(selected_splats(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """All selected models, or after an error none."""
        objects = selected_splats(context)
        try:
            models = [model_of(obj, np.eye(4)) for obj in objects]
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for obj, model in zip(objects, models, strict=True):
            old = obj.data
            mesh = bpy.data.meshes.new(old.name)
            write_attributes(mesh, model)
            obj.data = mesh
            obj.matrix_world = Matrix.Identity(4)
            if not old.users:
                bpy.data.meshes.remove(old)
        return {"FINISHED"}
