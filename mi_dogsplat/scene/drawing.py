"""What a model's file says on how it is to be drawn: it travels with the model from format to format.

In PLY files it is lines of the header, ``comment dogsplat NAME VALUE`` with the names of the fields below, and
``comment SplatRenderMode: mip`` or ``default`` (Brush, gsplat). Brush's ``Vertical axis: y`` and Postshot's
``antialiased 1`` are read as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from .orientation import UP, up_vector

EXTRAS = "dogsplat"  # our name in extras, and in comments
RENDER_MODES = {"mip": True, "default": False}
ROUNDING = 1e-5  # relative: lengths that are said may have been scaled in float32
BRUSH_UP = {"x": "x", "y": "-y", "z": "-z"}  # what Brush means by its vertical axis


@dataclass(frozen=True)
class Drawing:
    """How a model is to be drawn; None where its file says nothing.

    Numbers of NumPy become plain ones, which every format can hold. Raises ``ValueError`` for what makes no sense.
    """

    antialiased: bool | None = None
    """opacities are compensated for the screen-space low-pass filter (Mip-Splatting)"""
    near_clip: float | None = None
    """primitives nearer to the camera plane are dropped, units of the model"""
    linear: bool | None = None
    """colours are linear radiance (Rec. 709), not display-referred sRGB"""
    up: str | None = None
    """what is up in the model: an axis or a direction, as ``orientation.py`` names it"""
    scale: float | None = None
    """metres of a unit of the model"""
    white: float | None = None
    """linear radiance that a screen shows as white"""

    def __post_init__(self) -> None:
        for name, value in self.said().items():
            plain = value_of(name, value.tolist() if hasattr(value, "tolist") else value)
            if plain is None:
                raise ValueError(f"Drawing: {name} is {value!r}, it must be {ALLOWED[name]}")
            object.__setattr__(self, name, plain)  # it is frozen

    def over(self, other: Drawing) -> Drawing:
        """What this says, and ``other`` where this says nothing."""
        return replace(other, **self.said())

    def enlarged(self, factor: float) -> Drawing:
        """The same for a model whose lengths are so many times as long; no near clip where that overflows."""
        near_clip = None if self.near_clip is None else value_of("near_clip", factor * self.near_clip)
        return replace(self, near_clip=near_clip)

    def said(self) -> dict[str, Any]:
        """What is said, by the names of the fields."""
        return {name: value for name in NAMES if (value := getattr(self, name)) is not None}


@dataclass(frozen=True)
class DrawnAs:
    """How a model is drawn, decided; the defaults are what is usual where nobody says anything."""

    antialiased: bool = False
    near_clip: float = 0.2
    linear: bool = False
    white: float = 1.0

    def beside(self, white: float | None) -> DrawnAs:
        """The same beside images with this ``white``, None for display-referred ones: a linear model in their
        exposure, so that what is behind it is as bright as behind them."""
        return self if white is None or not self.linear else replace(self, white=white)


def drawn_as(*said: Drawing) -> DrawnAs:
    """What is decided by several that have a say, the first before the second."""
    decided = Drawing()
    for drawing in said:
        decided = decided.over(drawing)
    known = {field.name for field in fields(DrawnAs)}
    return DrawnAs(**{name: value for name, value in decided.said().items() if name in known})


USUAL: dict[str, Any] = asdict(DrawnAs()) | {"scale": 1.0, "up": UP}
"""What readers take where a file is silent, by the names of the fields of ``Drawing``."""


def told(value: Any) -> Any:
    """A value as lines tell it: of a length that was scaled in float32 six digits."""
    return f"{value:.6g}" if isinstance(value, float) else value


def differences(a: Drawing, b: Drawing) -> list[str]:
    """What two models disagree in, as ``scale 1 and 0.31``; what is not said counts as what is usual."""
    of_a, of_b = USUAL | a.said(), USUAL | b.said()
    pairs = {name: (of_a[name], of_b[name]) for name in USUAL if not _same(name, of_a[name], of_b[name])}
    return [f"{name} {told(of_a)} and {told(of_b)}" for name, (of_a, of_b) in pairs.items()]


def _same(name: str, a: Any, b: Any) -> bool:
    if name == "up":
        return bool(np.allclose(up_vector(a), up_vector(b), rtol=0, atol=ROUNDING))
    return math.isclose(a, b, rel_tol=ROUNDING)


NAMES = tuple(field.name for field in fields(Drawing))
ALLOWED = {
    "antialiased": "True or False",
    "near_clip": "zero or more, and finite",
    "linear": "True or False",
    "up": "an axis, as -y, or a direction, as 0,0.6,0.8",
    "scale": "above zero, and finite",
    "white": "above zero, and finite",
}
FLAGS = {"true": True, "false": False, "1": True, "0": False}


def comments_of(drawing: Drawing) -> list[str]:
    """Comments of a PLY header that say the same; the values are read back exactly."""
    lines = [f"{EXTRAS} {name} {_text(value)}" for name, value in drawing.said().items()]
    modes = [name for name, on in RENDER_MODES.items() if on == drawing.antialiased]
    return lines + [f"SplatRenderMode: {name}" for name in modes]


def drawing_of(comments: Iterable[str]) -> Drawing:
    """What the comments of a PLY header say; ours come first, what makes no sense is passed over."""
    ours: dict[str, Any] = {}
    others: dict[str, Any] = {}
    for comment in comments:
        match comment.split():
            case ["dogsplat", name, text] if name in NAMES:
                value = value_of(name, text)
                if value is not None:
                    ours[name] = value
            case ["antialiased", "0" | "1" as text]:  # Postshot
                others["antialiased"] = FLAGS[text]
            case ["SplatRenderMode:", mode] if mode in RENDER_MODES:
                others["antialiased"] = RENDER_MODES[mode]
            case ["Vertical", "axis:", axis] if axis.lower() in BRUSH_UP:
                others["up"] = BRUSH_UP[axis.lower()]
    return Drawing(**others | ours)


def drawing_of_extras(extras: Any) -> Drawing:
    """What the ``extras`` of a glTF or SOG file say under our name; what makes no sense is passed over."""
    ours = extras.get(EXTRAS) if isinstance(extras, dict) else None
    if not isinstance(ours, dict):
        return Drawing()
    return Drawing(**{name: value_of(name, ours[name]) for name in NAMES if name in ours})


def value_of(name: str, value: Any) -> Any:
    """A field's value from what a foreign file has under its name; None for what makes no sense."""
    if name in ("antialiased", "linear"):
        return value if isinstance(value, bool) else FLAGS.get(str(value).lower())
    if name == "up":
        return _direction(value)
    if isinstance(value, bool):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    usable = math.isfinite(number) and (number > 0 if name in ("scale", "white") else number >= 0)
    return number if usable else None


def _direction(value: Any) -> str | None:
    try:
        up_vector(value)
    except (ValueError, AttributeError, TypeError):
        return None
    return value


def _text(value: Any) -> str:
    """One word; a direction may have spaces between its numbers."""
    return str(value).lower() if isinstance(value, bool) else "".join(str(value).split())
