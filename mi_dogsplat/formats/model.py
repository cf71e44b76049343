"""What a model file holds: primitives, how they are to be drawn, and what of the file was left out."""

from __future__ import annotations

from dataclasses import dataclass

from ..scene.drawing import Drawing
from ..scene.splats import Splats


@dataclass(frozen=True)
class Model:
    """The content of a model file."""

    splats: Splats
    """in the axes of 3DGS PLY: right, down, forward"""
    drawing: Drawing = Drawing()
    left_out: tuple[str, ...] = ()
    """a line for each thing in the file that has no place here"""
