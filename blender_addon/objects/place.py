"""Where the splats are that cameras follow: an object, or what a collection has of which there is an instance."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from .attributes import has_splats
from .conventions import placement


@dataclass(frozen=True)
class Place:
    """Of splats; ``maker``: the object that makes the instance, where it is that of one."""

    splats: bpy.types.Object
    maker: bpy.types.Object | None = None

    @contextmanager
    def known(self, context: bpy.types.Context) -> Iterator[None]:
        """Meanwhile ``matrix`` is that of each frame, also of what is hidden, which Blender does not evaluate."""
        with known_place(context, *filter(None, (self.splats, self.maker))):
            yield

    @property
    def matrix(self) -> np.ndarray:
        """[4, 4] from coordinates of the file to Blender's."""
        own = placement(self.splats)
        if self.maker is None:
            return own
        offset = Matrix.Translation(-self.maker.instance_collection.instance_offset)
        return np.array(self.maker.matrix_world, np.float64) @ np.array(offset) @ own

    def now(self, context: bpy.types.Context) -> Matrix:
        """``matrix`` in the frame of the scene."""
        with self.known(context):
            return Matrix(self.matrix)


def place_of(obj: bpy.types.Object | None) -> Place | None:
    """Of an object with splats, or one that makes an instance of a collection with one such object."""
    if obj is None or not (has_splats(obj) or (obj.instance_type == "COLLECTION" and obj.instance_collection)):
        return None
    if has_splats(obj):
        return Place(obj)
    found = [inner for inner in obj.instance_collection.all_objects if has_splats(inner)]
    return Place(found[0], obj) if len(found) == 1 else None


@contextmanager
def known_place(context: bpy.types.Context, *objects: bpy.types.Object) -> Iterator[None]:
    """Meanwhile the matrices of objects are those of each frame, also of what is hidden."""
    with ExitStack() as probes:
        for obj in objects:
            probes.enter_context(_probe(context, obj))
        context.view_layer.update()
        yield


@contextmanager
def _probe(context: bpy.types.Context, obj: bpy.types.Object) -> Iterator[None]:
    """An empty that has Blender evaluate where an object is, and nothing of its geometry."""
    probe = bpy.data.objects.new(f"{obj.name} place", None)
    try:
        context.scene.collection.objects.link(probe)
        probe.constraints.new("COPY_TRANSFORMS").target = obj
        yield
    finally:
        bpy.data.objects.remove(probe)
