"""What a command is told about the up axis and the unit of a model that exists."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ..scene.drawing import Drawing
from ..support.errors import DataError
from ..support.settings import Setting, check_settings
from .world import Length, Unit, Up, check_world, metres_of_unit, world_of_data

UPRIGHT = "turn and scale the primitives, so that up is -y (y in SPZ, glTF and OpenUSD) and a unit is a metre"


@dataclass(frozen=True)
class WorldConfig:
    """What stands beside a field's type is the help text of its flag. Raises ``DataError`` that names the flag."""

    up: Up = None
    scale: Length = None
    unit: Unit = None
    upright: Annotated[bool, Setting(UPRIGHT)] = False

    def __post_init__(self) -> None:
        check_settings(self)
        check_world(self.up, self.scale, self.unit)

    def over(self, said: Drawing, data: str | Path | None) -> Drawing:
        """What is said here, then what a model has ``said``, then what the data say themselves, in which a length is
        measured. Raises ``DataError``."""
        unit = self.unit
        if unit is None and self.scale is not None:
            if not data:
                raise DataError("--scale", "needs the cameras of a data set", "add --data DATA, or give --unit METRES")
            unit = metres_of_unit(data, self.scale)
        found = Drawing(up=self.up, scale=unit).over(said)
        if data and (found.up is None or found.scale is None):
            found = found.over(world_of_data(data).drawing)
        if self.upright and found.up is None and found.scale is None:
            raise DataError("--upright", "nothing says what is up in the model", "add --up AXIS, as --up=-y")
        return found
