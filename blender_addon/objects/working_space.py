"""Blender's working space, which files choose from 5.0 on: splats have the colours of Rec. 709 in all of them.

Blender converts colours of attributes when that choice changes, and so the raw coefficients that are stored as such.
"""

from __future__ import annotations

import bpy

from ..files.errors import told

OURS = "Linear Rec.709"


def working_space() -> str:
    """Of this file; Blender before 5.0 has ours alone."""
    return bpy.data.colorspace.working_space if hasattr(bpy.data, "colorspace") else OURS


def working_space_notes() -> list[str]:
    """What to say where it is not ours; nothing else."""
    if (space := working_space()) == OURS:
        return []
    problem = "the working space {space} makes colors of splats wrong; choose {ours}, then import the models again"
    return [told(problem, space=space, ours=OURS)]
