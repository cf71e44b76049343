"""What passes of a picture tell of an object."""

from __future__ import annotations

from typing import NamedTuple

import bpy


class ShownObject(NamedTuple):
    """Its name, and its pass index in this frame; two of one name may come from two files."""

    name: str
    index: int

    @staticmethod
    def of(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> ShownObject:
        """Of an object, evaluated or not."""
        return ShownObject(obj.original.name, obj.original.evaluated_get(depsgraph).pass_index)
