"""How the shapes of a scene are drawn: as the integrator says, and where it says nothing, as their files do."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from ..scene.drawing import ROUNDING, USUAL, Drawing, DrawnAs, drawn_as

PROPERTIES = {"antialiased": "antialiased", "near_clip": "near_clip", "linear": "srgb_primitives"}  # of the integrator


def agreed(own: Drawing, shapes: Iterable[Any]) -> DrawnAs:
    """What is decided for ``dog`` shapes that are drawn together.

    own: what the integrator was told. Raises ``RuntimeError`` where it was told nothing and two files disagree. A file
    that says nothing goes along with the others, but for its colours: they are sRGB, and would be far too bright or
    dark.
    """
    said: dict[str, tuple[Any, str]] = {}
    for shape in shapes:
        colors = {"linear": USUAL["linear"]} if shape.means.shape[0] else {}
        for name, value in (colors | shape.drawing.said()).items():
            other, source = said.setdefault(name, (value, shape.source))
            if name in PROPERTIES and not _same(other, value) and getattr(own, name) is None:
                raise RuntimeError(
                    f"dogsplat: {source} is to be drawn with {name} {other}, {shape.source} with {value}; "
                    f'set "{PROPERTIES[name]}" of the integrator'
                )
    return drawn_as(own, Drawing(**{name: value for name, (value, _) in said.items()}))


def _same(a: float, b: float) -> bool:
    return math.isclose(a, b, rel_tol=ROUNDING)
