"""Models that have a place in a scene: in glTF by their nodes, in OpenUSD by their prims.

A matrix that only sets a model upright and in metres, as we write it, is left out: the model keeps its own numbers, and
says by itself what is up and how long a unit is.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.drawing import Drawing
from ..scene.orientation import UP, placement
from ..scene.splats import Array
from ..scene.transform import mean_scale, transformed
from ..support.errors import DataError
from .model import Model
from .packing import Turn

SAME = 1e-6  # relative difference of matrices


def placing(drawing: Drawing, turn: Turn) -> Array:
    """The matrix [4, 4] that sets a model upright and in metres, as far as it says; in the axes ``turn``, with y up."""
    axes = np.diag([*turn[0], 1.0])
    return axes @ placement(drawing.up, drawing.scale, UP) @ axes


def require_alike(path: Path, found: list[tuple[Model, Array]]) -> None:
    """Raise ``DataError`` for linear and display-referred models in one file, of which there is no one model."""
    if len({bool(model.drawing.linear) for model, _ in found}) > 1:
        raise DataError(path, "mixes linear and display-referred primitives", "export two files, one of each")


def in_one_place(found: list[tuple[Model, Array]], turn: Turn) -> Model:
    """One model of those that are found with their matrices [4, 4]: in the axes that they say to have, where all
    matrices do the same and no more than that; else in those of the scene, with y up. What the first says on its
    drawing holds, then what the second says. There has to be one at least.

    Raises ``ValueError`` for matrices that no model can be moved by.
    """
    alike = all(_says(model.drawing, matrix, turn) and np.array_equal(matrix, found[0][1]) for model, matrix in found)
    models = [model if alike else _moved(model, matrix) for model, matrix in found]
    drawing = Drawing()
    for model in reversed(models):
        drawing = model.drawing.over(drawing)
    left_out = tuple(dict.fromkeys(line for model in models for line in model.left_out))
    return Model(models[0].splats.joined(*(model.splats for model in models[1:])), drawing, left_out)


def _says(drawing: Drawing, matrix: Array, turn: Turn) -> bool:
    """Whether a matrix does no more than what its model says by itself."""
    placed = placing(drawing, turn)
    known = np.allclose(matrix, placed, rtol=0, atol=SAME * abs(placed).max())
    return known or np.array_equal(matrix, np.eye(4))


def _moved(model: Model, matrix: Array) -> Model:
    """The model where its matrix has it. What it said of its place is over then: the axes and metres of the scene
    hold."""
    said, drawing = {"up": UP, "scale": 1.0}, model.drawing
    now: dict[str, Any] = {name: value for name, value in said.items() if getattr(drawing, name) is not None}
    factor = mean_scale(matrix)
    drawing = replace(drawing.enlarged(1.0 if abs(factor - 1) < SAME else factor), **now)  # a turn is not quite 1
    return replace(model, splats=transformed(model.splats, matrix), drawing=drawing)
