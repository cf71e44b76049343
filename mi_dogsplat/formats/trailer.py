"""Rows of DoG, slopes, curvatures, cuts and shifts behind a compressed PLY, a byte a number, where others do not look.

The header says ``comment dogsplat dog VERSION ROWS``, and so of ``slopes``, ``curvatures``, ``cuts``,
``second_cuts`` and ``shifts``. Behind the data of the last element they follow in this order, each as (little-endian):

==========  ===========================================================================================
bounds      float32: the smallest of each number between bounds, then the largest
rows        ROWS times: skip, of DoG f_a, and the numbers between bounds
==========  ===========================================================================================

``skip`` counts the primitives without a row since the one of the row before; 255 passes over 255 of them, and the rest
of such a row means nothing. f_a is (byte + 1/2) / 256. Between bounds, at byte / 255, lie log F of three axes, nine
sign(s) log(1 + 64 |s|) of the slopes s, axis by axis, six such numbers of curvatures, three sign(n) log(1 + |n|) of
the normal n of a cut, and nine of shifts as of slopes: so a faint one keeps its share beside a strong one. The mean
views that follow shifts are directions, and lie between bounds as they are: a component is within 0.004.

They are no elements because readers count these: splat-transform refuses a compressed PLY with one more. Bytes behind
the last element and comments it leaves alone, as PlayCanvas does. Of DoG eight bits lose 0.005 dB at most
(docs/export_details.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..scene import row_groups
from ..scene.ply_tables import TableReader
from ..scene.splats import Array, Splats
from .packing import logits

VERSION = 1
MAX_LOG_F = 20.0
MAX_LOG = 85.0  # of a slope or normal in its unit: beyond lies the end of float32
LONGEST_SKIP = 255  # of a row without a primitive


@dataclass(frozen=True)
class Rows:
    """A kind of rows: its name in the header and in words, its bytes as they are, and its numbers between bounds."""

    name: str
    kind: str
    whole: int
    bounded: int
    most: float
    """that a bound can be, of either sign"""
    unit: float = 1.0
    """of signed numbers: below it they are told apart evenly, above by their ratio"""
    even: int = 0
    """of the numbers between bounds, how many at the end are told apart evenly, whatever their size"""

    @property
    def bounds_bytes(self) -> int:
        """Of both bounds."""
        return 8 * self.bounded

    @property
    def row_bytes(self) -> int:
        """Of a row."""
        return 1 + self.whole + self.bounded

    def size(self, n_rows: int) -> int:
        """Bytes of so many rows with their bounds."""
        return self.bounds_bytes + self.row_bytes * n_rows if n_rows else 0

    def encode(self, index: Array, whole: Array, numbers: Array) -> tuple[list[str], bytes]:
        """The comment and the bytes of primitives ``index`` [M]: bytes [M, whole], numbers [M, bounded]."""
        if not len(index):
            return [], b""
        bounds = np.stack([numbers.min(axis=0), numbers.max(axis=0)]).astype("<f4")  # [2, bounded]
        extent = (bounds[1] - bounds[0]).astype(np.float64)
        share = (numbers - bounds[0]) / np.where(extent > 0, extent, 1)
        passed = np.diff(index.astype(np.int64), prepend=-1) - 1  # [M] primitives without a row before each
        at = np.cumsum(passed // LONGEST_SKIP + 1) - 1  # [M] its row
        rows = np.zeros((at[-1] + 1, self.row_bytes), np.uint8)
        rows[:, 0] = LONGEST_SKIP
        rows[at, 0] = passed % LONGEST_SKIP
        rows[at, 1 : 1 + self.whole] = whole
        rows[at, 1 + self.whole :] = np.clip(np.round(share * 255), 0, 255)
        return [f"dogsplat {self.name} {VERSION} {len(rows)}"], bounds.tobytes() + rows.tobytes()

    def encode_signed(self, index: Array, values: Array) -> tuple[list[str], bytes]:
        """The same of rows that are signed numbers [M, bounded] alone."""
        sizes = np.abs(values.astype(np.float64))
        codes = np.where(self._is_even, sizes, np.log1p(sizes / self.unit))
        signed = np.sign(values) * np.minimum(codes, self.most)
        return self.encode(index, np.zeros((len(signed), 0), np.uint8), signed)

    def decode_signed(self, reader: TableReader, part: bytes, n: int) -> tuple[Array, Array]:
        """(index [M], signed numbers [M, bounded]), as ``decode``."""
        index, _, codes = self.decode(reader, part, n)
        sizes = np.where(self._is_even, np.abs(codes), np.expm1(np.abs(codes)) * self.unit)
        return index, np.sign(codes) * sizes

    @property
    def _is_even(self) -> Array:
        return np.arange(self.bounded) >= self.bounded - self.even

    def decode(self, reader: TableReader, part: bytes, n: int) -> tuple[Array, Array, Array]:
        """(index [M] below ``n``, bytes [M, whole], numbers [M, bounded]) of ``part``. Raises ``DataError``."""
        low, high = np.frombuffer(part, "<f4", 2 * self.bounded).astype(np.float64).reshape(2, self.bounded)
        if not (np.abs(low) <= self.most).all() or not ((low <= high) & (high <= self.most)).all():
            reader.fail(f"the bounds of its {self.kind} rows make no sense")
        rows = np.frombuffer(part, np.uint8, offset=self.bounds_bytes).reshape(-1, self.row_bytes)
        of_primitive = rows[:, 0] < LONGEST_SKIP
        index = np.cumsum(rows[:, 0].astype(np.int64) + of_primitive)[of_primitive] - 1  # [M]
        if len(index) and index[-1] >= n:
            reader.fail(f"a {self.kind} row is for primitive {index[-1]}, but the model has {n} (0 to {n - 1})")
        values = rows[of_primitive, 1:]
        share = values[:, self.whole :].astype(np.float64) / 255
        return index.astype(np.uint32), values[:, : self.whole], low + (high - low) * share

    def announced(self, reader: TableReader) -> int:
        """How many rows the header announces."""
        for comment in reader.comments:
            match comment.split():
                case ["dogsplat", self.name, version, rows] if version.isdecimal() and _is_count(rows):
                    if int(version) != VERSION:
                        problem = f"its {self.kind} rows are of version {version}, known is {VERSION}"
                        reader.fail(problem, "update mi_dogsplat, or export the model again")
                    return int(rows)
        return 0


DOG = Rows("dog", "DoG", 1, 3, MAX_LOG_F)
SLOPES, CUTS = Rows("slopes", "slope", 0, 9, MAX_LOG, 1 / 64), Rows("cuts", "cut", 0, 3, MAX_LOG)
CURVATURES = Rows("curvatures", "curvature", 0, 6, MAX_LOG, 1 / 64)
SECOND_CUTS = Rows("second_cuts", "second cut", 0, 3, MAX_LOG)
SHIFTS = Rows("shifts", "shift", 0, 12, MAX_LOG, 1 / 64, even=3)
SIGNED = dict(zip((SLOPES, CURVATURES, CUTS, SECOND_CUTS), row_groups.OWN_AXES, strict=True))
SIGNED[SHIFTS] = row_groups.SHIFTS


def encode(splats: Splats) -> tuple[list[str], bytes]:
    """Comments for the header, and what is to follow the last element; nothing for a model of none of them."""
    f_a = np.clip(np.floor(splats.dog_opacities.astype(np.float64) * 256), 0, 255).astype(np.uint8)[:, None]
    logs = np.clip(splats.dog_log_scales.astype(np.float64), -MAX_LOG_F, MAX_LOG_F)  # [M, 3]
    comments, rows = DOG.encode(splats.dog_index, f_a, logs)
    for kind, group in SIGNED.items():
        index = getattr(splats, group.index)
        values = [getattr(splats, name).reshape(len(index), math.prod(shape)) for name, shape in group.arrays.items()]
        about, more = kind.encode_signed(index, np.concatenate(values, axis=1))
        comments, rows = comments + about, rows + more
    return comments, rows


def decode(reader: TableReader, trailer: bytes, n: int) -> dict[str, Array]:
    """The arrays of all kinds in ``Splats`` of N primitives, of a file whose tables are read. Raises ``DataError``."""
    sizes = {kind: kind.size(kind.announced(reader)) for kind in (DOG, *SIGNED)}
    if len(trailer) != sum(sizes.values()):
        told = [f"{kind.announced(reader)} {kind.kind} rows are {size}" for kind, size in sizes.items()]
        reader.fail(f"{len(trailer)} bytes follow the last element; {', '.join(told)}")
    start, found = sizes[DOG], {}
    if start:
        index, f_a, logs = DOG.decode(reader, trailer[:start], n)
        found |= {"dog_index": index, "dog_logit_opacities": logits((f_a[:, 0] + 0.5) / 256), "dog_log_scales": logs}
    for kind, group in SIGNED.items():
        part = trailer[start : start + sizes[kind]]
        if part:
            index, values = kind.decode_signed(reader, part, n)
            ends = np.cumsum([math.prod(shape) for shape in group.arrays.values()])
            of_arrays = zip(group.arrays.items(), np.split(values, ends[:-1], axis=1), strict=True)
            found |= {group.index: index} | {name: part.reshape(-1, *shape) for (name, shape), part in of_arrays}
        start += len(part)
    return found


def _is_count(word: str) -> bool:
    return word.isdecimal() and len(word) <= 18
