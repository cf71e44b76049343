"""What must fit in the tensors of a shape ``dog``; each raises ``RuntimeError`` where it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..scene.row_groups import in_several
from ..scene.sh_basis import SH_SIZES
from ..support.wording import counted


def require_sh_size(shape: tuple) -> int:
    """Number of SH coefficients per channel in ``sh_coeffs`` of this shape."""
    size = shape[1] if len(shape) == 3 else 0
    if size not in SH_SIZES:
        raise RuntimeError(f'dog: "sh_coeffs" has shape {shape}, expected (N, 1/4/9/16, 3)')
    return size


def require_rows(shapes: Mapping[str, tuple], rows: Mapping[str, tuple], n: int, like: str) -> None:
    """Every tensor in ``rows`` (name to the shape of a row) has ``n`` rows, as ``like`` has."""
    for name, tail in rows.items():
        if shapes[name] != (n, *tail):
            of_row = ", ".join(map(str, tail))
            expected = f"(N, {of_row})" if name == like else f'{(n, *tail)} to match "{like}"'
            raise RuntimeError(f'dog: "{name}" has shape {shapes[name]}, expected {expected}')


def require_index(name: str, index: np.ndarray, n: int) -> None:
    """It names some of ``n`` primitives, each once and in order."""
    if index.size and int(index.max()) >= n:
        named, rows = int(index.max()), counted(n, "row")
        raise RuntimeError(f'dog: "{name}" names primitive {named}, "means" has {rows}; correct it')
    if np.any(index[1:] <= index[:-1]):
        raise RuntimeError(f'dog: "{name}" is not strictly increasing; sort it, each primitive once')


def require_one_degree(indices: Sequence[np.ndarray], size: int) -> None:
    """A primitive has one SH degree: that of ``size`` coefficients in ``sh_coeffs``, or of the group it is in."""
    if size > 1 and any(len(index) for index in indices):
        raise RuntimeError(f'dog: "sh_coeffs" has {size} coefficients; beside groups of SH degrees it has 1')
    if (twice := in_several(indices)) is not None:
        names = '"sh1_index", "sh2_index", "sh3_index"'
        raise RuntimeError(f"dog: primitive {twice} is in several of {names}; it has one degree")
