"""Bytes of a model in the formats that a training can end in, and what each part of a primitive adds to them.

A PLY file with rows for each SH degree holds what its primitives hold: its prices are those of the layout. SPZ and SOG
compress, and how well depends on the model: their prices are measured, as differences between encodings of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ..scene.drawing import Drawing, comments_of
from ..scene.ply import write_ply
from ..scene.radiance import brightened
from ..scene.row_groups import BESIDE_COLORS, RowGroup
from ..scene.splats import MAX_SH_DEGREE, Splats
from .coded import CODED, snapped
from .grids import MOST_ENTRIES
from .model import Model
from .packing import morton_order
from .write import write_model

KINDS = ("ply", "spz", "sog")
FLOAT, INDEX = 4, 4  # bytes
VERTEX = 17 * FLOAT  # position, normal, constant colour, opacity, scales, rotation
BLOCK = 1024  # primitives that are neighbours in the order of a file
BLOCKS = 12  # of them, at most, are encoded to measure prices: for a larger model, spread over it


@dataclass(frozen=True)
class Prices:
    """Bytes of a file by what it holds."""

    fixed: float  # of the file
    bands: tuple[float, ...]  # of a primitive with the bands up to degree 0, 1, 2, 3
    rows: Mapping[RowGroup, float]  # of a row of each group of ``BESIDE_COLORS``, 0 where the format has none

    def of(self, splats: Splats) -> float:
        """Bytes of the file of a model, as far as prices tell."""
        rows = sum(price * len(getattr(splats, group.index)) for group, price in self.rows.items())
        return self.fixed + float(np.take(self.bands, splats.sh_degrees).sum()) + rows

    def scaled(self, factor: float) -> Prices:
        """All but the fixed part times ``factor``."""
        bands = tuple(factor * price for price in self.bands)
        return Prices(self.fixed, bands, {group: factor * price for group, price in self.rows.items()})


@dataclass(frozen=True)
class FileKind:
    """A format that a training can end in, of ``KINDS``, and how the file says that its model is drawn.

    ``in_units_of_white``: of linear images models are given so here, as in training; the file has their radiance.
    """

    name: str
    drawing: Drawing = Drawing()
    in_units_of_white: bool = False

    def encoded(self, splats: Splats) -> bytes:
        """The file of a model; its primaries, whole, in their mean colours and places, where the format has no more."""
        if self.in_units_of_white and self.drawing.white is not None:
            splats = brightened(splats, self.drawing.white)
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"model.{self.name}"
            if self.name == "ply":
                write_ply(path, splats, "rows", comments_of(self.drawing))
            else:
                write_model(path, Model(splats.plain().without_cuts().uniform_sh(), self.drawing))
            return path.read_bytes()

    def size(self, splats: Splats) -> int:
        """Its bytes."""
        return len(self.encoded(splats))

    def foreseen(self, splats: Splats, most: int = MOST_ENTRIES) -> Splats:
        """A model in training as its end will leave it, where the format has grids (``coded.py``): on these, and with
        so many entries of a palette at ``most`` for each SH degree."""
        if self.name not in CODED:
            return splats
        return snapped(self.name, _bare(splats), rounds=0, linear=bool(self.drawing.linear), most=most)


def by_part(kind: FileKind, splats: Splats) -> dict[str, int]:
    """Bytes of the file of a model by what is in it, in order: what each part adds to a file with those before it.

    ``primitives``: all but what follows; ``sh1``, ``sh2``, ``sh3``: the bands of that degree; ``dog``; ``slopes``;
    ``curvatures``; ``cuts``; ``second_cuts``; ``shifts``. Parts that add nothing are left out.
    """
    degrees, bare, still = splats.sh_degrees, _bare(splats), splats.without_shifts()
    sizes = {"primitives": kind.size(bare.uniform_sh(0))}
    for degree in range(1, splats.sh_degree + 1):
        sizes[f"sh{degree}"] = kind.size(bare.with_sh_degrees(np.minimum(degrees, degree)))
    if splats.n_dog:
        sizes["dog"] = kind.size(still.without_slopes().without_cuts())
    if splats.n_slopes:
        sizes["slopes"] = kind.size(still.without_curvatures().without_cuts())
    if splats.n_curvatures:
        sizes["curvatures"] = kind.size(still.without_cuts())
    if splats.n_cuts:
        sizes["cuts"] = kind.size(still.without_second_cuts())
    if splats.n_second_cuts:
        sizes["second_cuts"] = kind.size(still)
    if splats.n_shifts:
        sizes["shifts"] = kind.size(splats)
    added = np.diff([0, *sizes.values()]).tolist()
    return {part: size for part, size in zip(sizes, added, strict=True) if size}


def _bare(splats: Splats) -> Splats:
    """Its primaries, whole, in their mean colours and at their mean places."""
    return splats.plain().without_slopes().without_cuts().without_shifts()


def prices(kind: FileKind, splats: Splats) -> Prices:
    """What the parts of a model cost in a format.

    Raises ``ValueError`` for a model without primitives.
    """
    if splats.n_splats == 0:
        raise ValueError("prices: the model is empty")
    if kind.name == "ply":
        bands = (VERTEX, *(VERTEX + INDEX + 3 * FLOAT * ((d + 1) ** 2 - 1) for d in range(1, MAX_SH_DEGREE + 1)))
        rows = {group: INDEX + group.row_size * FLOAT for group in BESIDE_COLORS}
        return Prices(kind.size(Splats.empty(0)), bands, rows)
    return _measured(kind, splats)


def _measured(kind: FileKind, splats: Splats) -> Prices:
    """Differences between encodings of a sample, on the grids of the format.

    A primitive of degree 0: of the sample and of a half of it, all without bands, which leaves the fixed part. A band:
    of the primitives that have it, with and without it, spread over all of them. Where none has it, as the band below.
    """
    sample = _sample(splats)

    def size(splats: Splats) -> int:
        return kind.size(kind.foreseen(splats))

    flat = sample.uniform_sh(0)
    whole, half = size(flat), size(_half(flat))
    base = max(1.0, (whole - half) / (flat.n_splats - flat.n_splats // 2))
    bands, degrees = [base], sample.sh_degrees
    for degree in range(1, MAX_SH_DEGREE + 1):
        have = sample.select(degrees >= degree)
        added = 0.0
        if have.n_splats:
            added = (size(have.uniform_sh(degree)) - size(have.uniform_sh(degree - 1))) / have.n_splats
        elif degree > 1:
            added = bands[-1] - bands[-2]
        bands.append(bands[-1] + max(0.0, added))
    return Prices(max(0.0, whole - base * flat.n_splats), tuple(bands), dict.fromkeys(BESIDE_COLORS, 0.0))


def _sample(splats: Splats) -> Splats:
    """Blocks of neighbours, spread over the model; all of a model that is no larger."""
    order = morton_order(splats.means)
    blocks = np.arange(len(order)) // BLOCK
    count = int(blocks[-1]) + 1
    if count <= BLOCKS:
        return splats
    chosen = np.linspace(0, count - 1, BLOCKS).astype(int)
    return splats.select(order[np.isin(blocks, chosen)])


def _half(splats: Splats) -> Splats:
    """The half of the primitives that comes first in the order of a file."""
    return splats.select(morton_order(splats.means)[: splats.n_splats // 2])
