"""How the model that is exported is to be drawn: as its file said, and as our modifier draws it now."""

from __future__ import annotations

import math
from dataclasses import replace

import bpy
import numpy as np

from ..files.said import Said
from ..files.transform import mean_scale
from ..native.convert import drawing_of
from ..nodes.tree import NEAR_CLIP
from ..objects.conventions import said_of


def said_of_all(first: bpy.types.Object, objects: list[bpy.types.Object], target: np.ndarray) -> Said:
    """What is said of objects that become one model, in the coordinates to which ``target`` [4, 4] brings the world.

    Up axis and scale are those of the file of the first one, whose coordinates these are. As in renders, one that is
    antialiased is enough, and the farthest near clip counts.
    """
    factor = mean_scale(target[:3, :3])
    antialiased = [value for obj in objects if (value := _antialiased(obj)) is not None]
    near = [value for obj in objects if (value := _near_clip(obj, factor)) is not None]
    said = replace(said_of(first), antialiased=any(antialiased) if antialiased else None)
    return replace(said, near_clip=max(near, default=None))


def _antialiased(obj: bpy.types.Object) -> bool | None:
    """None where neither the file nor anybody else has said it."""
    said = said_of(obj).antialiased
    now = drawing_of(obj).get("Antialiased", said)
    return None if said is None and not now else bool(now)


def _near_clip(obj: bpy.types.Object, factor: float) -> float | None:
    """In units of the file that is written, ``factor`` of one in Blender; the very number of the file that was read."""
    said, now = said_of(obj).near_clip, drawing_of(obj).get("Near Clip")
    if now is None:
        return said
    if said is None and math.isclose(now * factor, NEAR_CLIP, rel_tol=1e-6):
        return None
    number = float(f"{now * factor:.6g}")
    return said if said is not None and math.isclose(number, said, rel_tol=1e-5) else number
