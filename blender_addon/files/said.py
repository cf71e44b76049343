"""What a file says on how its model is to be drawn, in the comments of its header: read, and written again."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from .light import Light

RENDER_MODES = {"mip": True, "default": False}
FLAGS = {"true": True, "false": False, "1": True, "0": False}
UP_AXES = ("X", "-X", "Y", "-Y", "Z", "-Z")
BRUSH_UP = {"x": "x", "y": "-y", "z": "-z"}  # what Brush means by its vertical axis


@dataclass(frozen=True)
class Said:
    """What a file says on how its model is to be drawn; None where it says nothing."""

    antialiased: bool | None = None
    near_clip: float | None = None
    linear: bool | None = None
    up: tuple[float, float, float] | None = None  # a direction of any length
    scale: float | None = None
    white: float | None = None  # linear radiance

    @property
    def light(self) -> Light:
        """What the colours mean."""
        return Light(bool(self.linear), self.white or 1.0)

    def lit(self, light: Light) -> Said:
        """The same of colours that mean this."""
        if light.linear:
            return replace(self, linear=True, white=light.white)
        return replace(self, linear=None if self.linear else self.linear, white=None)

    @property
    def comments(self) -> list[str]:
        """Lines of a PLY header that say it; ``said_in`` finds the very same values."""
        lines = [f"dogsplat {name} {_text(value)}" for name, value in vars(self).items() if value is not None]
        modes = [name for name, on in RENDER_MODES.items() if on == self.antialiased]
        return lines + [f"SplatRenderMode: {name}" for name in modes]


def said_in(comments: list[str]) -> Said:
    """What the comments of a PLY header say; ours come before those of others, nonsense is passed over."""
    ours: dict[str, object] = {}
    others: dict[str, object] = {}
    for comment in comments:
        match comment.split():
            case ["dogsplat", "antialiased" | "linear" as name, flag] if flag.lower() in FLAGS:
                ours[name] = FLAGS[flag.lower()]
            case ["dogsplat", "up", name] if (up := direction(name)) is not None:
                ours["up"] = up
            case ["dogsplat", "scale" | "white" as name, number] if _positive(number):
                ours[name] = float(number)
            case ["dogsplat", "near_clip", number] if _positive(number, or_zero=True):
                ours["near_clip"] = float(number)
            case ["antialiased", "0" | "1" as flag]:  # of Postshot
                others["antialiased"] = FLAGS[flag]
            case ["SplatRenderMode:", mode] if mode in RENDER_MODES:
                others["antialiased"] = RENDER_MODES[mode]
            case ["Vertical", "axis:", axis] if axis.lower() in BRUSH_UP:
                others["up"] = direction(BRUSH_UP[axis.lower()])
    return Said(**others | ours)  # type: ignore[arg-type]


def direction(name: str) -> tuple[float, float, float] | None:
    """The vector of an axis, as ``-y``, or of three numbers, ``0.1,-0.9,0.4``; None for anything else."""
    if name.upper() in UP_AXES:
        x, y, z = (float(axis == name[-1].upper()) * (-1 if name[0] == "-" else 1) for axis in "XYZ")
        return x, y, z
    try:
        x, y, z = (float(word) for word in name.split(","))
    except ValueError:
        return None
    return (x, y, z) if 1e-6 < math.hypot(x, y, z) < 1e6 else None


def _positive(text: str, or_zero: bool = False) -> bool:
    try:
        number = float(text)
    except ValueError:
        return False
    return 0 < number < float("inf") or (or_zero and number == 0)


def _text(value: bool | float | tuple[float, float, float]) -> str:
    if isinstance(value, tuple):
        return next((name.lower() for name in UP_AXES if direction(name) == value), ",".join(map(repr, value)))
    return str(value).lower()
