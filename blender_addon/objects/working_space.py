"""Blender's working space, which files choose from 5.0 on: the numbers that its engines calculate with for colours.

Splats are those of Rec. 709 in every file. What their nodes draw, what is sent to the package and what that draws is
converted on the way.

Where another space is chosen, Blender 5.0 and 5.1 convert the colours of attributes, and so the raw coefficients that
are stored as such. On the way they divide by the opacity and keep five decimals, which nobody can undo to the bit.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Color

from ..files.errors import told

OURS = "Linear Rec.709"
CONVERTS_ATTRIBUTES = (5, 0, 0) <= bpy.app.version < (5, 2, 0)
IMPORTED_IN = "dogsplat_working_space"  # of an object; without it, it came into a file in Linear Rec.709


def working_space() -> str:
    """Of this file; Blender before 5.0 has ours alone."""
    return bpy.data.colorspace.working_space if hasattr(bpy.data, "colorspace") else OURS


def working_matrix() -> np.ndarray:
    """[3, 3] from linear Rec. 709 to the working space."""
    if working_space() == OURS:
        return np.eye(3)
    return np.array([Color(axis).from_rec709_linear_to_scene_linear() for axis in np.eye(3).tolist()], np.float64).T


def to_working(color: np.ndarray) -> np.ndarray:
    """Linear colours [..., 3] of Rec. 709 as Blender has them; the same bits where that is no difference."""
    return color if working_space() == OURS else color @ working_matrix().T.astype(np.float32)


def from_working(color: Any) -> np.ndarray:
    """The same backwards."""
    values = np.asarray(color)
    return values if working_space() == OURS else values @ np.linalg.inv(working_matrix()).T


def remember_space(obj: bpy.types.Object) -> None:
    """Write down the working space in which splats come into the file."""
    if (space := working_space()) != OURS:
        obj[IMPORTED_IN] = space


def is_converted(obj: bpy.types.Object) -> bool:
    """Whether Blender has converted the coefficients of an object's splats."""
    return CONVERTS_ATTRIBUTES and obj.get(IMPORTED_IN, OURS) != working_space()


def converted_notes(objects: list[bpy.types.Object]) -> list[str]:
    """What to say of splats whose colours are wrong; nothing else."""
    problem = '"{name}": its colors are wrong since the working space {space} was chosen; import the model again'
    return [told(problem, name=obj.name, space=working_space()) for obj in objects if is_converted(obj)]
