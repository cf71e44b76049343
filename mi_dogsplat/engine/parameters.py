"""Model parameters on the device: flat row-major arrays by name, as ``project`` reads them."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..scene.row_groups import BESIDE_COLORS, DOG, GROUPS, SH, RowGroup
from ..scene.sh_basis import sh_degree_of
from ..scene.splats import DENSE, Splats
from .rows import NO_ROW
from .sh_groups import ROW_COEFFICIENTS, has_groups, padded_rows, sh_columns

RAW = DENSE
RAW_DOG = DOG.names
RAW_OF_GROUPS = tuple(name for group in BESIDE_COLORS for name in group.names)
ALIGNMENT = 64  # bytes; Dr.Jit compiles another kernel for memory that is less aligned


def device_array(values: np.ndarray, dtype: Any = None) -> Any:
    """A flat array on the device, ``mi.Float`` unless told otherwise, that shares no memory with ``values``."""
    kind = np.dtype({mi.UInt32: np.uint32, device_bytes(): np.uint8}.get(dtype, np.float32))
    n_bytes = np.size(values) * kind.itemsize
    buffer = np.empty(n_bytes + ALIGNMENT, np.uint8)
    start = -buffer.ctypes.data % ALIGNMENT
    flat = buffer[start : start + n_bytes].view(kind)
    flat.reshape(np.shape(values))[...] = values  # one copy, whatever their order and type
    return (dtype or mi.Float)(flat)


def device_tensor(values: np.ndarray) -> mi.TensorXf:
    """A tensor of the same shape that shares no memory with ``values``."""
    return mi.TensorXf(device_array(values), values.shape)


def device_bytes() -> Any:
    """The type of arrays of bytes."""
    return dr.uint8_array_t(mi.Float)


def upload(splats: Splats) -> dict:
    """Arrays of the current variant; those of a group (``row_groups.py``) only when a primitive is in it.

    Rows of ``sh1_coeffs`` and ``sh3_coeffs`` are padded, see ``sh_groups.py``.
    """
    params: dict = {name: device_array(getattr(splats, name)) for name in RAW}
    for group in BESIDE_COLORS:
        index = getattr(splats, group.index)
        if len(index):
            params |= {name: device_array(getattr(splats, name)) for name in group.names}
            params[group.index] = device_array(index, mi.UInt32)
            params[group.row] = rows_of_splats(index, splats.n_splats)
    for group in SH.values():
        index, (name,) = getattr(splats, group.index), group.names
        if len(index):
            params[name] = device_array(padded_rows(getattr(splats, name)))
            params[group.index] = device_array(index, mi.UInt32)
    return params


def rows_of_splats(index: np.ndarray, n_splats: int) -> mi.UInt32:
    """[N] row of each primitive in a group, or NO_ROW: the inverse of its index [M]."""
    rows = np.full(n_splats, NO_ROW, np.uint32)
    rows[index] = np.arange(len(index), dtype=np.uint32)
    return device_array(rows, mi.UInt32)


def concatenate(parts: list[dict], sh_sizes: list[int]) -> tuple[dict, int]:
    """Several models as one. Differentiable.

    Args:
        parts: parameters as ``upload`` makes them.
        sh_sizes: number of SH coefficients of each, of a mixed model those of its highest degree. Smaller ones are
            padded with zeros; but beside a mixed model each of the others becomes a group of its degree.

    Returns: (parameters, number of SH coefficients).
    """
    filled = [k for k, p in enumerate(parts) if dr.width(p["logit_opacities"])] or [0]
    parts, sh_sizes = [parts[k] for k in filled], [sh_sizes[k] for k in filled]
    if len(parts) == 1:
        return parts[0], sh_sizes[0]
    counts, size = [dr.width(p["logit_opacities"]) for p in parts], max(sh_sizes)
    parts = _with_equal_colors(parts, counts, sh_sizes)
    joined: dict = {name: dr.concat([p[name] for p in parts]) for name in RAW}
    for group in GROUPS:
        joined |= _joined_group(group, parts, counts)
    return joined, size


def _with_equal_colors(parts: list[dict], counts: list[int], sh_sizes: list[int]) -> list[dict]:
    """Models as they are, but for their SH coefficients: all mixed, or all uniform of one size."""
    of_parts = list(zip(parts, counts, sh_sizes, strict=True))
    if any(has_groups(p) for p in parts):
        return [p if has_groups(p) else _grouped(p, n, size) for p, n, size in of_parts]
    largest = max(sh_sizes)
    return [p | {"sh_coeffs": sh_columns(p["sh_coeffs"], n, size, 0, largest)} for p, n, size in of_parts]


def _joined_group(group: RowGroup, parts: list[dict], counts: list[int]) -> dict:
    """What the models together have of a group: nothing, or its arrays, its index and, if kernels read it, its row."""
    first_splats = np.cumsum([0, *counts[:-1]]).tolist()
    having = [(p, first) for p, first in zip(parts, first_splats, strict=True) if group.index in p]
    if not having:
        return {}
    index = np.concatenate([p[group.index].numpy() + first for p, first in having])
    joined = {name: dr.concat([p[name] for p, _ in having]) for name in group.names}
    joined[group.index] = device_array(index, mi.UInt32)
    if group in BESIDE_COLORS:
        joined[group.row] = rows_of_splats(index, sum(counts))
    return joined


def _grouped(params: dict, n: int, size: int) -> dict:
    """A uniform model of ``n`` primitives as a mixed one, in which they are all in the group of its degree."""
    coeffs = params["sh_coeffs"]
    grouped = params | {"sh_coeffs": sh_columns(coeffs, n, size, 0, 1)}
    if size > 1:
        degree = sh_degree_of(size)
        grouped[SH[degree].index] = dr.arange(mi.UInt32, n)
        grouped[SH[degree].names[0]] = sh_columns(coeffs, n, size, 1, 1 + ROW_COEFFICIENTS[degree])
    return grouped
