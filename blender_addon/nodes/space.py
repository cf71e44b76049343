"""For which working space the trees of an object have to be."""

from __future__ import annotations

import bpy

from ..objects.conventions import light_of
from ..objects.working_space import OURS, working_space
from .groups import RADIANCE


def space_of(obj: bpy.types.Object) -> str:
    """Empty for Linear Rec.709; of linear models with an end that says so."""
    if (space := working_space()) == OURS:
        return ""
    return space + RADIANCE if light_of(obj).linear else space
