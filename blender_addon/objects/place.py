"""Where an object is that is hidden: Blender evaluates what a view layer has, and what that asks for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from .conventions import placement


@contextmanager
def known_place(context: bpy.types.Context, obj: bpy.types.Object) -> Iterator[None]:
    """Meanwhile the object's matrix is that of each frame, wherever it is hidden. Nothing of its geometry is evaluated:
    an empty asks for its place alone."""
    probe = bpy.data.objects.new(f"{obj.name} place", None)
    try:
        context.scene.collection.objects.link(probe)
        probe.constraints.new("COPY_TRANSFORMS").target = obj
        context.view_layer.update()
        yield
    finally:
        bpy.data.objects.remove(probe)


def placement_now(context: bpy.types.Context, obj: bpy.types.Object) -> np.ndarray:
    """``placement`` of an object that may be hidden."""
    with known_place(context, obj):
        return placement(obj)
