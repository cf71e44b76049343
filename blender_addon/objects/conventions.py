"""Which way is up in a file, and how objects remember where they came from."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..files.errors import readable, told
from ..files.light import Light
from ..files.linear_map import is_similarity
from ..files.said import Said

SOURCE, CONVENTION, IMPORT_MATRIX = "dogsplat_source", "dogsplat_convention", "dogsplat_import_matrix"
APPLIED = "dogsplat_applied"  # from coordinates of the file to those of the mesh, once a transform was applied
SAID = "dogsplat_said"  # what the file says on how its model is drawn
LINEAR, WHITE = "dogsplat_linear", "dogsplat_white"  # of models in linear radiance only
DOG_COUNT = "dogsplat_dog_count"  # of the model as it was imported
DRAWING = "dogsplat_drawing"  # of native splats: how our modifier drew them
UP_AXES = (
    ("Z", "Z", "As in the file: for Blender, Mitsuba and instant-ngp scenes"),
    ("-Z", "-Z", "Turned upside down"),
    ("Y", "Y", "For models with y up, as many viewers use"),
    ("-Y", "-Y", "For models with y down, as COLMAP without orientation makes them"),
)
_TO_Z_UP = {
    "Z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)), "-Z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "Y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)), "-Y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
}  # fmt: skip
_AXES = {"Z": Vector((0, 0, 1)), "-Z": Vector((0, 0, -1)), "Y": Vector((0, 1, 0)), "-Y": Vector((0, -1, 0))}


def conversion(up: str | tuple[float, float, float], scale: float) -> Matrix:
    """The matrix from coordinates of a file to Blender's; ``up`` is one of ``UP_AXES``, or a direction.

    A direction is turned to -y first, the shortest way, as the package turns it for glTF and OpenUSD: so a model lies
    where Blender's own import puts such a file of it, whichever way it leans.
    """
    if not isinstance(up, str):
        nearest = Vector(up).normalized()
        named = next((name for name, vector in _AXES.items() if (vector - nearest).length < 1e-6), None)
        if named is None:
            level = Matrix(_TO_Z_UP["-Y"]) @ nearest.rotation_difference(_AXES["-Y"]).to_matrix()
            return Matrix.Scale(scale, 4) @ level.to_4x4()
        up = named
    return Matrix.Scale(scale, 4) @ Matrix(_TO_Z_UP[up]).to_4x4()


def metres_of_unit(scene: bpy.types.Scene) -> float:
    """How long a unit of the scene is; a metre where it has none, as for Blender's own importers."""
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else settings.scale_length


def remember(obj: bpy.types.Object, source: str, convention: str, matrix: Matrix) -> None:
    """Write down the file, its convention and the matrix from its coordinates to Blender's."""
    obj[SOURCE], obj[CONVENTION] = readable(source), convention
    obj[IMPORT_MATRIX] = [value for row in matrix for value in row]


def remember_said(obj: bpy.types.Object, said: Said) -> None:
    """Write down what the file of a model says, and what its colours mean."""
    obj[SAID] = {name: value for name, value in vars(said).items() if value is not None}
    if said.light.linear:
        obj[LINEAR], obj[WHITE] = True, said.light.white


def said_of(obj: bpy.types.Object) -> Said:
    """What the file of an object's splats says; nothing for objects from elsewhere."""
    values = dict(obj.get(SAID, {}))
    return Said(**values | {"up": tuple(values["up"])} if "up" in values else values)


def light_of(obj: bpy.types.Object) -> Light:
    """What the colours of an object's splats mean; sRGB values where nothing is written down."""
    return Light(bool(obj.get(LINEAR, False)), float(obj.get(WHITE, 1.0)))


def import_matrix(obj: bpy.types.Object) -> np.ndarray:
    """[4, 4] from coordinates of the file to Blender's; the identity for objects from elsewhere. Raises ``ValueError``
    for numbers that are none, as anybody may edit them."""
    matrix = _matrix(obj, IMPORT_MATRIX)
    if matrix is None:
        problem = 'the custom property {name} of "{object}" is no matrix with an inverse; remove it, or import again'
        raise ValueError(told(problem, name=IMPORT_MATRIX, object=obj.name))
    return matrix


def placement(obj: bpy.types.Object) -> np.ndarray:
    """[4, 4] from coordinates of the file to Blender's as the object is placed now."""
    return np.array(obj.matrix_world, np.float64) @ _sound(obj, APPLIED)


def note_applied(obj: bpy.types.Object, matrix: np.ndarray) -> None:
    """Remember that all splats of an object went through a [4, 4], so that cameras of its file still fit.

    No camera of the file sees a model that is stretched or mirrored. Those that fit are of the file that it would be
    exported to.
    """
    applied = matrix @ _sound(obj, APPLIED)
    if not is_similarity(applied[:3, :3]):
        applied = _sound(obj, IMPORT_MATRIX)
    obj[APPLIED] = applied.ravel().tolist()


def _sound(obj: bpy.types.Object, name: str) -> np.ndarray:
    """A matrix that is written down, or the identity: of a damaged one as where there is none."""
    matrix = _matrix(obj, name)
    return np.eye(4) if matrix is None else matrix


def _matrix(obj: bpy.types.Object, name: str) -> np.ndarray | None:
    """[4, 4], the identity where none is written down; None for what has no inverse, or is no matrix."""
    values = obj.get(name)
    if values is None:
        return np.eye(4)
    try:
        matrix = np.array(list(values), np.float64).reshape(4, 4)
    except (TypeError, ValueError):
        return None
    sound = np.isfinite(matrix).all() and np.linalg.det(matrix) != 0
    return matrix if sound else None
