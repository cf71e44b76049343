"""What a model file holds: primitives, how they are to be drawn, and what of the file was left out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..scene.drawing import Drawing
from ..scene.row_groups import GROUPS
from ..scene.splats import DENSE, Splats
from ..support.errors import DataError


@dataclass(frozen=True)
class Model:
    """The content of a model file."""

    splats: Splats
    """in the axes of 3DGS PLY: right, down, forward"""
    drawing: Drawing = Drawing()
    left_out: tuple[str, ...] = ()
    """a line for each thing in the file that has no place here"""


def require_finite(path: Path, splats: Splats, remedy: str) -> None:
    """Raise ``DataError`` about a file where a number of its model is none, with the first such primitive."""
    of_groups = {name: getattr(splats, group.index) for group in GROUPS for name in group.names}
    for name in (*DENSE, *of_groups):
        bad = np.argwhere(~np.isfinite(getattr(splats, name)))
        if len(bad):
            first = of_groups[name][bad[0][0]] if name in of_groups else bad[0][0]
            problem = f"has values of {name} that are not finite: {len(bad)}, the first in primitive {first}"
            raise DataError(path, problem, remedy)
