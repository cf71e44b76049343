"""A model in memory as a shape ``dog`` of a scene, for which it need not be in a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi

from ..engine.parameters import RAW, device_array, device_tensor
from ..formats.model import Model
from ..scene.row_groups import GROUPS
from ..scene.splats import Splats
from ..support.variants import require_supported
from .given_model import SAYS, model_of
from .properties import matrix_of


def to_dog(model: Splats | Model | str | Path | mi.Shape, *, to_world: Any = None) -> dict[str, Any]:
    """A shape for ``mi.load_dict``, alone or in the dict of a scene, of type ``dog``.

    It has the tensors of the model under their names in ``Splats``, those of groups where a primitive is in them, and
    what the model says on how it is drawn: ``antialiased``, ``near_clip``, ``linear`` and ``white``. So a scene of it
    gives the same picture as one that loads the file of the model, to the bit. What is up in the model and how long its
    unit is have no effect on pictures, and are not in the dict. The tensors share no memory with the model, and take no
    gradients to it: those are of the parameters that ``mi.traverse`` finds in the loaded shape or scene.

    Args:
        model: primitives, with how they are drawn or alone, the path of a file in any format, or a loaded shape
            ``dog`` (its parameters of this moment).
        to_world: 4 x 4, any map that does not flatten (``mi.ScalarTransform4f``, ``mi.Transform4f`` or an array),
            with which the shape moves the model when it is loaded.

    Raises ``ValueError`` for what is no model and for a transform that is not one matrix [4, 4]; ``DataError`` for a
    file that is no model; ``RuntimeError`` in a variant in which the shape is not available. What else is wrong with a
    transform ``mi.load_dict`` finds.
    """
    require_supported("to_dog")
    model = model_of(model, "to_dog")
    splats, groups = model.splats, [group for group in GROUPS if len(getattr(model.splats, group.index))]
    names = [*RAW, *(name for group in groups for name in group.names)]
    shape: dict[str, Any] = {"type": "dog"}
    shape |= {name: device_tensor(getattr(splats, name)) for name in names}
    tensor_of_integers: Any = mi.TensorXu
    for group in groups:
        index = getattr(splats, group.index)
        shape[group.index] = tensor_of_integers(device_array(index, mi.UInt32), index.shape)
    shape |= {name: value for name, value in model.drawing.said().items() if name in SAYS}
    if to_world is not None:
        shape["to_world"] = mi.ScalarTransform4f(matrix_of(to_world))
    return shape
