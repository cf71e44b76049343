"""The model that a shape ``dog`` is given: a file, or tensors; and what else is taken for a model in Python."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.parameters import RAW
from ..formats.model import Model
from ..formats.read import read_model
from ..scene.drawing import Drawing, value_of
from ..scene.row_groups import GROUPS
from ..scene.splats import Splats
from .properties import given

SAYS = {"antialiased": bool, "near_clip": float, "linear": bool, "white": float}
"""What the shape may be told on how it is drawn, as a file says it: fields of ``Drawing`` that pictures depend on."""


def given_model(props: Any) -> tuple[Model, str]:
    """The model as it is given, before ``to_world``, and where it is from: the path of its file, or the shape.

    How it is drawn is what the shape is told, and where it is told nothing what the file says.

    Raises ``RuntimeError`` for both or neither, for missing tensors, and for what is no way to draw; ``TypeError``,
    ``ValueError`` and ``OSError`` for a model that cannot be used.
    """
    model, source = _primitives(props)
    return replace(model, drawing=_told(props).over(model.drawing)), source


def _primitives(props: Any) -> tuple[Model, str]:
    of_groups = [name for group in GROUPS for name in (group.index, *group.names)]
    tensors = [name for name in (*RAW, *of_groups) if name in props]
    if ("filename" in props) == bool(tensors):
        raise RuntimeError(
            'dog: specify either "filename" or the tensors "means", "log_scales", "quats", "logit_opacities" and '
            f'"sh_coeffs"; found {"both" if tensors else "neither"}'
        )
    if not tensors:
        resolver = cast(Any, mi.file_resolver)()
        source = str(resolver.resolve(given(props, "filename", str)))
        return read_model(source), source
    if missing := [name for name in RAW if name not in tensors]:
        raise RuntimeError(f"dog: missing tensors {', '.join(missing)}; give them, too")
    return Model(Splats(**{name: on_host(props[name]) for name in tensors})), f'shape "{props.id()}" of tensors'


def _told(props: Any) -> Drawing:
    """What the shape is told on how it is drawn."""
    told: dict[str, Any] = {}
    for name, kind in SAYS.items():
        value = given(props, name, kind)
        if value is None:
            continue
        told[name] = value_of(name, value)
        if told[name] is None:
            least = "above zero" if name == "white" else "zero or more"
            raise RuntimeError(f'dog: "{name}" is {value}, it must be {least} and finite')
    return Drawing(**told)


def model_of(model: Splats | Model | str | Path | mi.Shape, caller: str) -> Model:
    """What is taken for a model: primitives alone, what a file holds, its path, or a loaded shape ``dog``.

    Raises ``ValueError`` that names the ``caller`` for anything else; ``DataError`` for a file that is no model.
    """
    if isinstance(model, Splats):
        return Model(model)
    if isinstance(model, (str, Path)):
        return read_model(model)
    if isinstance(model, Model):
        return model
    if is_dog_shape(model):
        shape: Any = model
        return Model(shape.to_splats(), shape.drawing)
    kind = type(model).__name__
    raise ValueError(f'{caller}: a model is Splats, Model, a path or a shape "dog", this is {kind}')


def is_dog_shape(value: Any) -> bool:
    """Whether it is a loaded shape ``dog``.

    Its class does not say: that is another one after each change of the variant, there and back too.
    """
    return hasattr(value, "to_splats")


def on_host(tensor: Any) -> np.ndarray:
    """A tensor of Dr.Jit, or what NumPy takes for an array."""
    return tensor.numpy() if dr.is_array_v(tensor) else np.asarray(tensor)
