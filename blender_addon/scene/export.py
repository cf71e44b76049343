"""What the parts of an export share: the folder of its files, and the lines about what could not be sent as it is."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..files.errors import told
from ..objects.working_space import from_working

Plugin = dict[str, Any]  # of Mitsuba: its "type", its parameters, and plugins in it; transforms as {"matrix": rows}


@dataclass
class Export:
    """A scene that is being written."""

    folder: Path
    notes: list[str] = field(default_factory=list)
    files: set[str] = field(default_factory=set)

    def write(self, content: bytes, suffix: str) -> str:
        """The name of a file, which is made from its content, so that no frame of a film writes one again."""
        name = hashlib.sha1(content).hexdigest() + suffix
        if not (self.folder / name).exists():
            part = self.folder / f"{name}.part"
            part.write_bytes(content)
            part.replace(self.folder / name)  # whole: its name says what it holds
        self.files.add(name)
        return name

    def note(self, text: str, **values: Any) -> None:
        """Say once what is drawn differently, or not at all; a template where there are values."""
        line = told(text, **values)
        if line not in self.notes:
            self.notes.append(line)


def rgb(color: Any) -> Plugin:
    """Three numbers as a colour."""
    return {"type": "rgb", "value": [float(c) for c in color[:3]]}


def blender_rgb(color: Any) -> Plugin:
    """The same of a colour of Blender's, which is of its working space and perhaps none that Rec. 709 has."""
    return rgb(np.maximum(from_working(color[:3]), 0))


def reflected_rgb(color: Any) -> Plugin:
    """The same of a surface, which in Mitsuba reflects, or lets through, no more light than it gets."""
    return rgb(np.minimum(blender_rgb(color)["value"], 1))


def matrix(values: Any) -> Plugin:
    """A transform."""
    return {"matrix": np.array(values, np.float64).tolist()}
