"""What the fields of a request may hold."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Kind:
    """Values of a field: what an error line calls them, and which ones they are."""

    name: str
    holds: Callable[[Any], bool]


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: Any) -> bool:
    return (_is_whole(value) or isinstance(value, float)) and math.isfinite(value)


def _list_of(holds: Callable[[Any], bool], length: int | None = None) -> Callable[[Any], bool]:
    def all_hold(value: Any) -> bool:
        return isinstance(value, list) and (length is None or len(value) == length) and all(map(holds, value))

    return all_hold


SWITCH = Kind("true or false", lambda value: isinstance(value, bool))
PATH = Kind("the name of a file", lambda value: isinstance(value, str) and value != "")
NUMBERS = Kind("a list of whole numbers of at least 0", _list_of(lambda value: _is_whole(value) and value >= 0))
KINDS = {
    "model": PATH,
    "scene": PATH,
    "near_clip": Kind("a number of at least 0", lambda value: _is_number(value) and value >= 0),
    "antialiased": SWITCH,
    "counts": NUMBERS,
    "holdout": NUMBERS,
    "indirect_only": NUMBERS,
    "passes": Kind("a list of names", _list_of(lambda value: isinstance(value, str))),
    "samples": Kind("a whole number of at least 0", lambda value: _is_whole(value) and value >= 0),
    "max_depth": Kind("a whole number from 1 to 2147483647", lambda value: _is_whole(value) and 1 <= value < 2**31),
    "seed": Kind("a whole number from 0 to 4294967295", lambda value: _is_whole(value) and 0 <= value < 2**32),
    "transparent": SWITCH,
    "hide_lamps": SWITCH,
    "mesh_shadows": SWITCH,
    "denoise": SWITCH,
    "orthographic": SWITCH,
    "film": Kind(
        "left, top, right and bottom of the whole picture, in pixels of the camera",
        lambda value: _list_of(_is_number, 4)(value) and value[0] < value[2] and value[1] < value[3],
    ),
    "share": Kind("a number above 0, at most 1", lambda value: _is_number(value) and 0 < value <= 1),
    "background": Kind("a list of three numbers", _list_of(_is_number, 3)),
    "linear": SWITCH,
    "clip": Kind(
        "a list of two numbers, the near end first, at least 0",
        lambda value: _list_of(_is_number, 2)(value) and 0 <= value[0] < value[1],
    ),
}  # by name of the field; "camera" is read as a camera file is
