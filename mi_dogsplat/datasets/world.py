"""What the axes and the unit of a data set mean: which way is up, and how long a unit is.

``dogsplat poses`` writes down what it has made of them in ``world.json`` beside the images, and so may anybody:
``{"up": "-y", "scale": 1.0}``, the direction that is up (``orientation.py``) and the metres of a unit; either may be
left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from ..scene.cameras import Camera
from ..scene.drawing import Drawing, value_of
from ..scene.orientation import MAX_ROLL, roll, up_name, up_of_cameras, up_vector
from ..support.errors import DataError
from ..support.files import read_object, write_json
from ..support.settings import Setting, refuse
from .dataset import Dataset

FILE = "world.json"
UP = "up axis: x, y, z, -x, -y, -z (write --up=-y), or a direction X,Y,Z (default: what is known or can be found)"
LENGTH = "metres between two places: where an image was taken (IMAGE), or a point in an image (IMAGE:X,Y in pixels)"
Up = Annotated[str | None, Setting(UP, "AXIS")]
Length = Annotated[tuple[str, str, str] | None, Setting(LENGTH, "A B METRES")]
Unit = Annotated[float | None, Setting("length of a unit in metres, if you know it", "METRES", 1e-12, 1e12)]


def check_world(up: str | None, scale: tuple[str, str, str] | None, unit: float | None = None) -> None:
    """Raise ``DataError`` for an ``Up`` that is no direction, a ``Length`` that is none, and one beside a ``Unit``."""
    if up is not None:
        try:
            up_vector(up)
        except ValueError as error:
            refuse("up", str(error), "use x, y, z, -x, -y or -z, or three numbers as 0.1,-0.9,0.4")
    if scale is not None and not 0 < metres(scale) < math.inf:
        refuse("scale", f'"{scale[2]}" is not a length', "use a number above 0")
    if scale is not None and unit is not None:
        refuse("scale", "says the same as --unit", "leave one of them out")


def metres(scale: tuple[str, str, str]) -> float:
    """Of a ``Length``; NaN if it is no number."""
    try:
        return float(scale[2])
    except ValueError:
        return math.nan


@dataclass(frozen=True)
class World:
    """``up`` as in ``Drawing``; ``scale`` in metres of a unit; None is what nobody knows."""

    up: str | None = None
    scale: float | None = None

    def over(self, other: World) -> World:
        """What this says, and ``other`` where this says nothing."""
        return World(self.up or other.up, self.scale or other.scale)

    @property
    def drawing(self) -> Drawing:
        """The same, as a model says it."""
        return Drawing(up=self.up, scale=self.scale)


def write_world(folder: Path, world: World) -> None:
    """Write ``world.json`` into the folder of a data set."""
    write_json(folder / FILE, {name: value for name, value in vars(world).items() if value is not None})


def read_world(folder: Path) -> World:
    """What ``world.json`` says; nothing where there is none. Raises ``DataError`` for what is no world."""
    path = folder / FILE
    if not path.is_file():
        return World()
    remedy = 'write {"up": "-y", "scale": 1.0}: an axis or X,Y,Z, and metres of a unit; or remove the file'
    content = read_object(path, remedy)
    if unknown := sorted(set(content) - {"up", "scale"}):
        raise DataError(path, f'"{unknown[0]}" is unknown', remedy)
    found = {name: value_of(name, content[name]) for name in ("up", "scale") if content.get(name) is not None}
    if wrong := [name for name, value in found.items() if value is None]:
        raise DataError(path, f'"{wrong[0]}" is {content[wrong[0]]!r}', remedy)
    return World(**found)


def world_of(dataset: Dataset, cameras: Sequence[Camera]) -> World:
    """What the data say themselves, else which way was up for most of the cameras. Raises ``DataError``."""
    return read_world(dataset.path).over(World(up_as_held(cameras)))


def world_of_data(data: str | Path) -> World:
    """What a data set says itself, of which nothing else is needed. Raises ``DataError``."""
    from . import load_largest  # here: photographs need the extra "train"

    return read_world(load_largest(data, spp=1)[0].path)


def up_as_held(cameras: Sequence[Camera]) -> str | None:
    """The vertical by how cameras were held, as ``Drawing`` has it; None where they were held anyhow."""
    c2w = np.stack([camera.c2w for camera in cameras])
    up = up_of_cameras(c2w)
    return up_name(up) if roll(c2w, up) < MAX_ROLL else None


def metres_of_unit(data: str | Path, scale: tuple[str, str, str]) -> float:
    """Metres of a unit by a ``Length`` in a data set. Raises ``DataError``."""
    from . import load_largest  # here: photographs need the extra "train"
    from .lengths import length_in_units, standpoints_of

    dataset, factor = load_largest(data, spp=1)
    return metres(scale) / length_in_units(scale[:2], standpoints_of(dataset, factor))
