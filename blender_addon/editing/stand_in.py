"""What brushes paint in the place of splats, which have no faces: an object with a tetrahedron per splat."""

from __future__ import annotations

import random

import bpy
import numpy as np

from ..files.errors import told
from ..nodes.modifier import edit_modifiers, get_input, set_input
from ..nodes.paint import CORNERS
from ..nodes.paint import NAME as PAINT
from ..objects.attributes import ERASE, PAINT_INDEX, PAINT_OWNER, SCALE, TINT, is_splats, own_data
from ..objects.columns import get_column, put_column
from .weights import get_weights, put_weights

TETRAHEDRON = np.array([(1, 1, 1), (-1, -1, 1), (-1, 1, -1), (1, -1, -1)], np.float32)
FACES = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)], np.int32)
SPLATS = "dogsplat_splats"  # how many a stand-in was made for
OWNERS = 2**24  # numbers that tell stand-ins apart, which single precision has; those of before have none, 0
UNPAINTED = {ERASE: (0.0,), TINT: (1.0, 1.0, 1.0, 1.0)}


def build_stand_in(obj: bpy.types.Object) -> bpy.types.Object:
    """A child of the model with what was painted before, linked to its collections; splats learn their index."""
    own_data(obj)
    positions, scales = get_column(obj.data, "position", 3), get_column(obj.data, SCALE, 3)
    n, owner = len(positions), random.randrange(1, OWNERS)
    put_column(obj.data, PAINT_INDEX, np.arange(n, dtype=np.int32))
    put_column(obj.data, PAINT_OWNER, np.full(n, owner, np.int32))
    radius = np.cbrt(scales.prod(axis=1, keepdims=True))[:, None]  # that of a ball of the same volume
    corners = (positions[:, None] + radius * TETRAHEDRON).reshape(-1, 3)
    mesh = bpy.data.meshes.new(f"{obj.name} paint")
    mesh[SPLATS] = n
    mesh.vertices.add(len(corners))
    mesh.vertices.foreach_set("co", corners.ravel())
    faces = (np.arange(n, dtype=np.int32)[:, None, None] * CORNERS + FACES).ravel()
    mesh.loops.add(len(faces))
    mesh.loops.foreach_set("vertex_index", faces)
    mesh.polygons.add(len(faces) // 3)
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(faces), 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    put_column(mesh, PAINT_OWNER, np.full(len(corners), owner, np.int32))
    put_column(mesh, TINT, np.repeat(_painted(obj.data, TINT), CORNERS, axis=0))
    mesh.attributes.active_color = mesh.attributes[TINT]
    stand_in = bpy.data.objects.new(mesh.name, mesh)
    for collection in obj.users_collection:
        collection.objects.link(stand_in)
    stand_in.parent, stand_in.hide_render = obj, True
    put_weights(stand_in, ERASE, np.repeat(_painted(obj.data, ERASE)[:, 0], CORNERS))
    return stand_in


def _painted(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """What the splats of a mesh have of a painted attribute, [N, 1] or [N, 4]."""
    nothing = UNPAINTED[name]
    if name not in mesh.attributes:
        return np.tile(np.float32(nothing), (len(mesh.vertices), 1))
    return get_column(mesh, name, len(nothing))


def stand_in_of(obj: bpy.types.Object) -> bpy.types.Object | None:
    """The object that is painted for a model."""
    return next((get_input(modifier, "Stand-In") for modifier in edit_modifiers(obj, PAINT)), None)


def show_stand_in(obj: bpy.types.Object, stand_in: bpy.types.Object, layer: bpy.types.ViewLayer) -> None:
    """Have a view layer show the stand-in of a model, which was deleted or hidden by hand; the modifier keeps it."""
    if stand_in.name not in layer.objects:
        for collection in obj.users_collection:
            if stand_in.name not in collection.objects:
                collection.objects.link(stand_in)
    stand_in.hide_viewport = False
    stand_in.hide_set(False, view_layer=layer)


def check_painting(obj: bpy.types.Object) -> None:
    """Raises ``ValueError`` where nobody knows what is painted on a model: its stand-in, or it, has lost something."""
    stand_in = stand_in_of(obj)
    if stand_in is None:
        return
    if len(stand_in.data.vertices) != CORNERS * stand_in.data.get(SPLATS, len(stand_in.data.vertices) // CORNERS):
        problem = (
            '"{name}": the number of its points has changed, so its painting does not fit any more; undo that, or '
            "delete it and its modifier"
        )
        raise ValueError(told(problem, name=stand_in.name))
    get_column(stand_in.data, TINT, 4)
    for model in _models_of(stand_in):
        get_column(model.data, PAINT_INDEX, 1)


def finish_painting(obj: bpy.types.Object) -> None:
    """Make what was painted attributes of the splats, and remove the stand-in; nothing where there is none.

    Duplicates of a model that is being painted have the same stand-in, and get the same. Raises ``ValueError`` as
    ``check_painting``, with all as it was.
    """
    check_painting(obj)
    stand_in = stand_in_of(obj)
    if stand_in is None:
        return
    painted, models, owners = _values(stand_in), _models_of(stand_in), _owners(stand_in.data)
    for mesh in {model.data for model in models}:
        _store(mesh, painted, owners)
    for model in models:
        for modifier in edit_modifiers(model, PAINT):
            set_input(modifier, "Stand-In", None)
        model.update_tag()
    mesh = stand_in.data
    bpy.data.objects.remove(stand_in)
    bpy.data.meshes.remove(mesh)


def keep_painted(obj: bpy.types.Object, mesh: bpy.types.Mesh) -> None:
    """Make what is painted on a model attributes of a mesh of some of its splats, as ``finish_painting`` of its own."""
    stand_in = stand_in_of(obj)
    if stand_in is not None and PAINT_INDEX in mesh.attributes:
        _store(mesh, _values(stand_in), _owners(stand_in.data))


def _models_of(stand_in: bpy.types.Object) -> list[bpy.types.Object]:
    return [obj for obj in bpy.data.objects if is_splats(obj) and stand_in_of(obj) == stand_in]


def _values(stand_in: bpy.types.Object) -> dict[str, np.ndarray]:
    """What is painted on its corners, [V, 1] and [V, 4]."""
    return {ERASE: get_weights(stand_in, ERASE), TINT: get_column(stand_in.data, TINT, 4)}


def _owners(mesh: bpy.types.Mesh) -> np.ndarray:
    """[V]: which stand-in the points of a mesh are of; 0 where nobody has said it."""
    if PAINT_OWNER not in mesh.attributes:
        return np.zeros(len(mesh.vertices), np.int32)
    return get_column(mesh, PAINT_OWNER, 1)[:, 0]


def _store(mesh: bpy.types.Mesh, painted: dict[str, np.ndarray], owners: np.ndarray) -> None:
    """Of the corners of all stand-ins, [V, 1] or [V, 4]: those of the splats of a mesh.

    Splats that were joined meanwhile are not of this stand-in, to which the ``owners`` [V] of its corners belong.
    """
    index = get_column(mesh, PAINT_INDEX, 1)[:, 0]
    mine = np.isin(_owners(mesh), owners)
    for attribute, values in painted.items():
        per_splat = _painted(mesh, attribute)
        per_splat[mine] = values.reshape(-1, CORNERS, values.shape[1]).mean(axis=1, dtype=np.float32)[index[mine]]
        if attribute in mesh.attributes or (per_splat != np.float32(UNPAINTED[attribute])).any():
            put_column(mesh, attribute, per_splat)
    for name in (PAINT_INDEX, PAINT_OWNER):
        if name in mesh.attributes:
            mesh.attributes.remove(mesh.attributes[name])
    mesh.update()
