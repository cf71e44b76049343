"""What ``dogsplat clean`` takes out beside what is not needed; what stands beside a field's type is its flag's help."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from ..support.settings import Setting, check_settings, refuse

BOX = "keep only what is in a box, given by its lowest and its highest corner"
SPHERE = "keep only what is in a sphere, given by its centre and radius"
MIN_OPACITY = "remove primitives with an opacity below this"
MAX_SCALE = "remove primitives with a scale above this, in units of the model"
CONNECTED = "keep only the N connected parts with the most primitives"
SEEN = "remove what no training view of --data sees"
MASKS = "keep only what is white in masks of the training views of --data"
FLOATERS = "remove what floats in space that the training views of --data look through"
MIXED_SH = (
    "give each primitive only the SH degree that it needs, if that makes the file smaller; "
    "other programs show such a file without its view-dependent colour"
)


@dataclass(frozen=True)
class CleanConfig:
    """Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed."""

    box: Annotated[tuple[float, float, float, float, float, float] | None, Setting(BOX, "X0 Y0 Z0 X1 Y1 Z1")] = None
    sphere: Annotated[tuple[float, float, float, float] | None, Setting(SPHERE, "X Y Z R")] = None
    min_opacity: Annotated[float | None, Setting(MIN_OPACITY, least=0, most=1)] = None
    max_scale: Annotated[float | None, Setting(MAX_SCALE, least=1e-30, most=1e30)] = None
    connected: Annotated[int | None, Setting(CONNECTED, least=1)] = None
    seen: Annotated[bool, Setting(SEEN)] = False
    masks: Annotated[str | None, Setting(MASKS, "FOLDER")] = None
    floaters: Annotated[bool, Setting(FLOATERS)] = False
    mixed_sh: Annotated[bool, Setting(MIXED_SH)] = False

    def __post_init__(self) -> None:
        check_settings(self)
        for name in ("box", "sphere"):
            if (numbers := getattr(self, name)) and not all(map(math.isfinite, numbers)):
                refuse(name, f"{_listed(numbers)} is not a place", "use finite numbers")
        if self.box:
            wrong = [axis for axis, low, high in zip("xyz", self.box[:3], self.box[3:], strict=True) if low > high]
            if wrong:
                remedy = "give its lowest corner first, then its highest"
                refuse("box", f"{_listed(self.box)} is inverted along {', '.join(wrong)}", remedy)
        if self.sphere and self.sphere[3] <= 0:
            refuse("sphere", f"a radius of {self.sphere[3]:g} holds nothing", "use a radius above 0")

    @property
    def needs_data(self) -> str:
        """The flag that asks for training views; empty if none does."""
        asked = {"--seen": self.seen, "--masks": self.masks, "--floaters": self.floaters}
        return next((flag for flag, value in asked.items() if value), "")


def _listed(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:g}" for number in numbers)
