"""A model whose own numbers are upright and in metres, for programs that do not read what a file says of that."""

from __future__ import annotations

from dataclasses import replace

from ..scene.orientation import UP, placement
from ..scene.splats import Array
from ..scene.transform import transformed
from .model import Model


def upright(model: Model) -> tuple[Model, Array]:
    """The model turned until up is -y and scaled until a unit is a metre, as far as it says; and by what [4, 4]."""
    said = model.drawing
    matrix, factor = placement(said.up, said.scale, UP), said.scale or 1.0
    now = replace(said.enlarged(factor), up=said.up and UP, scale=said.scale and 1.0)
    return replace(model, splats=transformed(model.splats, matrix), drawing=now), matrix
