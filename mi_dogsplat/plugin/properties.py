"""Parameters of a plugin, of the type that they are meant to have."""

from __future__ import annotations

from typing import Any

import numpy as np

WORDS = {bool: "true or false", int: "an integer", float: "a number", str: "a string"}


def given(props: Any, name: str, kind: type, default: Any = None) -> Any:
    """The parameter ``name``, or the default. Raises ``RuntimeError`` where it is not of ``kind``, as C++ plugins do.

    An integer is a number too, but a string such as ``"false"`` is no boolean.
    """
    if name not in props:
        return default
    value = props[name]
    if not (type(value) is kind or (kind is float and type(value) is int)):
        raise RuntimeError(f'{props.plugin_name()}: "{name}" is {value!r}, it must be {WORDS[kind]}')
    return value


def matrix_of(transform: Any) -> np.ndarray:
    """[4, 4] of a transform, of Mitsuba's plain numbers or of its arrays, or of what NumPy takes for a matrix.

    Raises ``ValueError`` for another shape, such as that of a transform several lanes wide.
    """
    matrix = np.array(getattr(transform, "matrix", transform), dtype=np.float64)
    if matrix.shape not in ((4, 4), (4, 4, 1)):
        wide = matrix.ndim == 3 and matrix.shape[:2] == (4, 4)
        found = f"{matrix.shape[2]} lanes wide" if wide else f"of shape {list(matrix.shape)}"
        raise ValueError(f"a model is moved by one matrix [4, 4]; this transform is {found}")
    return matrix.reshape(4, 4)
