"""Model parameters on the device: flat row-major arrays by name, as ``project`` reads them."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..scene.splats import Splats
from .project import NOT_DOG

RAW = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")
RAW_DOG = ("dog_logit_opacities", "dog_log_scales")


ALIGNMENT = 64  # bytes; Dr.Jit compiles another kernel for memory that is less aligned


def device_array(values: np.ndarray, dtype: Any = None) -> Any:
    """A flat array on the device, ``mi.Float`` unless told otherwise, that shares no memory with ``values``."""
    kinds = {mi.UInt32: np.uint32, device_bytes(): np.uint8}
    flat = np.ravel(values).astype(kinds.get(dtype, np.float32))
    buffer = np.empty(flat.nbytes + ALIGNMENT, np.uint8)
    start = -buffer.ctypes.data % ALIGNMENT
    aligned = buffer[start : start + flat.nbytes].view(flat.dtype)
    aligned[:] = flat
    return (dtype or mi.Float)(aligned)


def device_bytes() -> Any:
    """The type of arrays of bytes."""
    return dr.uint8_array_t(mi.Float)


def upload(splats: Splats) -> dict:
    """Arrays of the current variant; the DoG entries only when there is a DoG primitive."""
    names = RAW + RAW_DOG if splats.n_dog else RAW
    params: dict = {name: device_array(getattr(splats, name)) for name in names}
    if splats.n_dog:
        params["dog_index"] = device_array(splats.dog_index, mi.UInt32)
        params["dog_row"] = dog_rows(splats.dog_index, splats.n_splats)
    return params


def dog_rows(dog_index: np.ndarray, n_splats: int) -> mi.UInt32:
    """[N] row of each primitive among the DoG ones, or NOT_DOG: the inverse of ``dog_index`` [M]."""
    rows = np.full(n_splats, NOT_DOG, np.uint32)
    rows[dog_index] = np.arange(len(dog_index), dtype=np.uint32)
    return device_array(rows, mi.UInt32)


def concatenate(parts: list[dict], sh_sizes: list[int]) -> tuple[dict, int]:
    """Several models as one. Differentiable.

    Args:
        parts: parameters as ``upload`` makes them.
        sh_sizes: number of SH coefficients of each; smaller ones are padded with zeros.

    Returns: (parameters, number of SH coefficients).
    """
    filled = [k for k, p in enumerate(parts) if dr.width(p["logit_opacities"])] or [0]
    parts, sh_sizes = [parts[k] for k in filled], [sh_sizes[k] for k in filled]
    if len(parts) == 1:
        return parts[0], sh_sizes[0]
    counts = [dr.width(p["logit_opacities"]) for p in parts]
    size = max(sh_sizes)
    joined: dict = {name: dr.concat([p[name] for p in parts]) for name in RAW if name != "sh_coeffs"}
    joined["sh_coeffs"] = dr.concat(
        [_pad_sh(p["sh_coeffs"], n, k, size) for p, n, k in zip(parts, counts, sh_sizes, strict=True)]
    )
    with_dog = [(p, first) for p, first in zip(parts, np.cumsum([0, *counts[:-1]]), strict=True) if "dog_index" in p]
    if with_dog:
        for name in RAW_DOG:
            joined[name] = dr.concat([p[name] for p, _ in with_dog])
        index = np.concatenate([p["dog_index"].numpy() + int(first) for p, first in with_dog])
        joined["dog_index"] = device_array(index, mi.UInt32)
        joined["dog_row"] = dog_rows(index, sum(counts))
    return joined, size


def _pad_sh(coeffs: mi.Float, n: int, stored: int, size: int) -> mi.Float:
    if stored == size:
        return coeffs
    i = dr.arange(mi.UInt32, n * size * 3)
    row, column = i // (size * 3), i % (size * 3)
    return dr.gather(mi.Float, coeffs, dr.fma(row, stored * 3, column), column < stored * 3)
