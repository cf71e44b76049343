"""Which object a primitive and a surface belong to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..plugin.surfaces import emits
from .mattes import NOTHING

AREA_LIGHTS = ("area", "directionalarea")  # emitters that are a part of a shape
OBJECT = "object_"  # begins the id of a shape that is one, and its number follows: object_3, object_3_glass
LARGEST = 2**24  # number: float32, in which mattes have them, does not tell larger ones apart


def object_of_primitive(index: np.ndarray, counts: Sequence[int]) -> np.ndarray:
    """The object of each primitive, [...], from ``counts`` of primitives, one object after the other."""
    ends = np.cumsum(counts or [np.iinfo(np.int64).max])
    return np.where(index >= 0, np.searchsorted(ends, index, side="right"), NOTHING).astype(np.int32)


def objects_shine(described: dict[str, Any]) -> bool:
    """Whether a shape that is an object emits light, in a dictionary for ``mi.load_dict``."""
    objects = [plugin for name, plugin in described.items() if name.startswith(OBJECT)]
    parts = [part for plugin in objects if isinstance(plugin, dict) for part in plugin.values()]
    return any(isinstance(part, dict) and part.get("type") in AREA_LIGHTS for part in parts)


def number_of_shape(name: str) -> int:
    """Of the object that a shape with this id is a part of. Raises ``ValueError`` for one that cannot be told."""
    if not name.startswith(OBJECT):
        return NOTHING
    number = name.split("_")[1]
    if not (number.isdecimal() and len(number) <= len(str(LARGEST)) and int(number) <= LARGEST):
        raise ValueError(f'the id "{name}" has no number of an object from 0 to {LARGEST}')
    return int(number)


class SurfaceObjects:
    """The numbers of the shapes of a scene, by their ids. shine: whether one of these emits light.

    Raises ``ValueError`` as ``number_of_shape``.
    """

    def __init__(self, scene: mi.Scene):
        numbers: dict[int, int] = {0: NOTHING}
        for shape in scene.shapes():  # as the registry of Dr.Jit numbers them
            pointer: Any = dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))
            (slot,) = pointer.numpy().tolist()
            numbers[slot] = number_of_shape(shape.id())
        values = np.full(max(numbers) + 1, NOTHING, np.int32)
        values[list(numbers)] = list(numbers.values())
        self._numbers, self.largest = mi.Int32(values), max(int(values.max()), 0)
        self.shine = any(shape.is_emitter() and shape.id().startswith(OBJECT) for shape in scene.shapes())

    def is_lamp(self, meeting: Any) -> mi.Bool:
        """Whether the shape that it is of emits light and is no object."""
        return emits(meeting) & (self.number(meeting) == NOTHING)

    def number(self, meeting: Any) -> mi.Int32:
        """Of the shape that a ``mi.PreliminaryIntersection3f`` is of; an instance counts for what it repeats."""
        pointers: Any = [dr.reinterpret_array(mi.UInt32, p) for p in (meeting.shape, meeting.instance)]
        of_shape, of_instance = pointers
        slot: Any = dr.select(of_instance != 0, of_instance, of_shape)
        known = meeting.is_valid() & (slot < dr.width(self._numbers))
        return dr.select(known, dr.gather(mi.Int32, self._numbers, slot, known), NOTHING)
