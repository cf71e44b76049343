"""Models that come in and go out as users have it, by the operators."""

from types import SimpleNamespace

import bpy
from known_trees import bring_trees

from blender_addon.files.model import Model
from blender_addon.files.ply import read_ply


def load(path, **options) -> bpy.types.Object:
    """Import a model and return its object, with trees that need not be built for each check."""
    bring_trees()
    assert bpy.ops.import_scene.dogsplat(filepath=str(path), **options) == {"FINISHED"}
    return bpy.context.object


def export(path, **options) -> Model:
    """Export what is selected and read it again."""
    assert bpy.ops.export_scene.dogsplat(filepath=str(path), **options) == {"FINISHED"}
    return read_ply(path)


def datablocks() -> SimpleNamespace:
    """How many there are of each kind that an import can leave behind."""
    kinds = ("objects", "meshes", "cameras", "collections", "images")
    return SimpleNamespace(**{kind: len(getattr(bpy.data, kind)) for kind in kinds})
