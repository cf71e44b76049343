"""The model that a shape ``dog`` is given: a file, or tensors."""

from __future__ import annotations

from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.parameters import RAW
from ..formats.model import Model
from ..formats.read import read_model
from ..scene.row_groups import GROUPS
from ..scene.splats import Splats
from .properties import given


def given_model(props: Any) -> tuple[Model, str]:
    """The model as it is given, before ``to_world``, and the path of its file, or ``tensors``.

    Raises ``RuntimeError`` for both or neither, and for missing tensors; ``TypeError``, ``ValueError`` and ``OSError``
    for a model that cannot be used.
    """
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
        raise RuntimeError(f"dog: missing tensors {', '.join(missing)}")
    return Model(Splats(**{name: on_host(props[name]) for name in tensors})), "tensors"


def on_host(tensor: Any) -> np.ndarray:
    """A tensor of Dr.Jit, or what NumPy takes for an array."""
    return tensor.numpy() if dr.is_array_v(tensor) else np.asarray(tensor)
