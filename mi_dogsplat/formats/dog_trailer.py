"""DoG rows at the end of a compressed PLY, five bytes each, where other readers do not look.

The header says ``comment dogsplat dog VERSION ROWS``. Behind the data of the last element follow, little-endian:

==========  ===========================================================================================
bounds      6 float32: the smallest log F of each axis, then the largest
rows        ROWS times 5 bytes: skip, f_a, and log F of three axes
==========  ===========================================================================================

``skip`` counts the plain primitives since the one of the row before; 255 passes over 255 of them, and the rest of such
a row means nothing. f_a is (byte + 1/2) / 256, log F lies at byte / 255 between its bounds.

It is no element because readers count these: splat-transform refuses a compressed PLY with one more. Bytes behind the
last element and comments it leaves alone, as PlayCanvas does. Eight bits lose 0.005 dB at most (docs/export.md).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..scene.ply_tables import TableReader
from ..scene.splats import Array, Splats
from .packing import logits

VERSION = 1
MAX_LOG_F = 20.0
LONGEST_SKIP = 255  # of a row without a primitive
BOUNDS_BYTES, ROW_BYTES = 24, 5


def encode(splats: Splats) -> tuple[list[str], bytes]:
    """Comments for the header, and what is to follow the last element; nothing for a model without DoG."""
    if not splats.n_dog:
        return [], b""
    logs = np.clip(splats.dog_log_scales.astype(np.float64), -MAX_LOG_F, MAX_LOG_F)  # [M, 3]
    bounds = np.stack([logs.min(axis=0), logs.max(axis=0)]).astype("<f4")  # [2, 3]
    extent = (bounds[1] - bounds[0]).astype(np.float64)
    share = (logs - bounds[0]) / np.where(extent > 0, extent, 1)
    passed = np.diff(splats.dog_index.astype(np.int64), prepend=-1) - 1  # [M] plain primitives before each
    at = np.cumsum(passed // LONGEST_SKIP + 1) - 1  # [M] its row
    rows = np.zeros((at[-1] + 1, ROW_BYTES), np.uint8)
    rows[:, 0] = LONGEST_SKIP
    rows[at, 0] = passed % LONGEST_SKIP
    rows[at, 1] = np.clip(np.floor(splats.dog_opacities.astype(np.float64) * 256), 0, 255)
    rows[at, 2:] = np.clip(np.round(share * 255), 0, 255)
    return [f"dogsplat dog {VERSION} {len(rows)}"], bounds.tobytes() + rows.tobytes()


def decode(reader: TableReader, trailer: bytes, n: int) -> dict[str, Array]:
    """The DoG arrays of ``Splats`` for N primitives, of a file whose tables are read. Raises ``DataError``."""
    n_rows = _announced(reader, reader.comments)
    expected = BOUNDS_BYTES + ROW_BYTES * n_rows if n_rows else 0
    if len(trailer) != expected:
        reader.fail(f"{len(trailer)} bytes follow the last element; {n_rows} DoG rows are {expected}")
    if not n_rows:
        return {}
    low, high = np.frombuffer(trailer, "<f4", 6).astype(np.float64).reshape(2, 3)
    if not (np.abs(low) <= MAX_LOG_F).all() or not ((low <= high) & (high <= MAX_LOG_F)).all():
        reader.fail("the bounds of its DoG rows make no sense")
    rows = np.frombuffer(trailer, np.uint8, offset=BOUNDS_BYTES).reshape(n_rows, ROW_BYTES)
    of_primitive = rows[:, 0] < LONGEST_SKIP
    index = np.cumsum(rows[:, 0].astype(np.int64) + of_primitive)[of_primitive] - 1  # [M]
    if len(index) and index[-1] >= n:
        reader.fail(f"a DoG row is for primitive {index[-1]}, but the model has {n} (0 to {n - 1})")
    values = rows[of_primitive].astype(np.float64)
    return {
        "dog_index": index.astype(np.uint32),
        "dog_logit_opacities": logits((values[:, 1] + 0.5) / 256),
        "dog_log_scales": low + (high - low) * values[:, 2:] / 255,
    }


def _announced(reader: TableReader, comments: Iterable[str]) -> int:
    """How many rows the header announces."""
    for comment in comments:
        match comment.split():
            case ["dogsplat", "dog", version, rows] if version.isdecimal() and rows.isdecimal() and len(rows) <= 18:
                if int(version) != VERSION:
                    problem = f"its DoG rows are of version {version}, known is {VERSION}"
                    reader.fail(problem, "update mi_dogsplat, or export the model again")
                return int(rows)
    return 0
