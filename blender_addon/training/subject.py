"""What a rig looks at: its objects, and the points of their evaluated surfaces."""

from __future__ import annotations

from itertools import product

import bpy
import numpy as np

from ..evaluated.masks import UNSEEN
from ..objects.attributes import is_splats
from ..objects.place import known_place
from ..scene.meshes import parts
from ..scene.write import WITH_FACES
from .deleted import is_there
from .settings import DogSplatTrainingSettings
from .surrounding_collections import rendered_objects


def subject_objects(context: bpy.types.Context, settings: DogSplatTrainingSettings) -> list[bpy.types.Object]:
    """Those whose place a model takes; none for a region. Raises ``ValueError`` where nothing is selected."""
    if settings.subject == "SELECTED":
        found = [obj for obj in context.selected_objects if obj.type not in UNSEEN]
        if not found:
            raise ValueError("nothing is selected; select the objects to train, or choose Whole Scene")
        return found
    if settings.subject == "REGION":
        return []
    rendered = rendered_objects(context.view_layer)
    return [obj for obj in context.scene.objects if obj.type not in UNSEEN and not obj.hide_render and obj in rendered]


def surface_points(depsgraph: bpy.types.Depsgraph, objects: list[bpy.types.Object]) -> np.ndarray:
    """Corners [P, 3] in the world of all faces of these objects and of what they make instances of."""
    wanted = {obj.name_full for obj in objects}
    geometry: dict[int, np.ndarray] = {}
    found = [np.zeros((0, 3))]
    for instance in depsgraph.object_instances:
        obj, owner = instance.object, instance.parent if instance.is_instance else instance.object
        if owner.name_full not in wanted or obj.type not in WITH_FACES or not instance.show_self:
            continue
        if is_splats(obj.original):
            continue
        key = obj.data.as_pointer()
        if key not in geometry:
            corners = [part.positions.reshape(-1, 3) for part in parts(obj)]
            geometry[key] = np.unique(np.concatenate([np.zeros((0, 3)), *corners]), axis=0)
        world = np.array(instance.matrix_world, np.float64)
        found.append(geometry[key] @ world[:3, :3].T + world[:3, 3])
    return np.concatenate(found)


def region_corners(context: bpy.types.Context, obj: bpy.types.Object | None) -> np.ndarray:
    """Corners [8, 3] in the world of the cube of an empty, or of an object's box, hidden or not. Raises
    ``ValueError``."""
    if not is_there(obj):
        raise ValueError("no region is chosen; choose an empty or another object that marks it")
    size = obj.empty_display_size
    corners = product((-size, size), repeat=3) if obj.type == "EMPTY" else obj.bound_box
    with known_place(context, obj):
        world = np.array(obj.matrix_world, np.float64)
    return np.array([tuple(corner) for corner in corners]) @ world[:3, :3].T + world[:3, 3]


def framed(
    context: bpy.types.Context, settings: DogSplatTrainingSettings, objects: list[bpy.types.Object]
) -> np.ndarray:
    """Points [P, 3] that the cameras have to see. Raises ``ValueError`` where they have no extent."""
    if settings.subject == "REGION":
        points = region_corners(context, settings.region)
    else:
        points = surface_points(context.evaluated_depsgraph_get(), objects)
    if not len(points) or not np.ptp(points, axis=0).max() > 0:
        raise ValueError("the subject has no surfaces; select objects with faces, or mark a region")
    return points


def sphere(points: np.ndarray) -> tuple[np.ndarray, float]:
    """(centre [3], radius) around points [P, 3]: that of their box, and as far as the farthest one."""
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    return center, float(np.linalg.norm(points - center, axis=1).max())
