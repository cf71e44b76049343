"""Compressed PLY (PlayCanvas): chunks of 256 primitives that share their bounds, four 32-bit words a primitive.

``chunk`` holds 18 floats: bounds of positions, of log scales, and of colours (0.5 + C0 f_dc); 12 in older files, whose
colours lie between 0 and 1. ``vertex`` holds what lies between them: position and log scale with 11, 10 and 11 bits per
axis, the rotation as the smallest three of (w, x, y, z) with 10 bits each and the index of the largest in the two upper
bits, and colour and opacity with 8 bits each. ``sh`` holds a byte per coefficient from -4 to 4, channel-major. Axes and
order of bands are those of 3DGS PLY.
Rows of DoG, slopes, curvatures, cuts and shifts are our own and follow the last element (``trailer.py``).

Layout: developer.playcanvas.com (PLY format), github.com/playcanvas/splat-transform (MIT).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..scene.drawing import drawing_of
from ..scene.ply_tables import TableReader
from ..scene.quaternions import WXYZ_FROM_XYZW, XYZW_FROM_WXYZ, unit_quaternions
from ..scene.sh_basis import C0
from ..scene.splats import Array, Splats
from ..support.wording import counted
from . import trailer
from .model import Model
from .packing import SQRT2, from_smallest_three, in_space, logits, misplaced, smallest_three

CHUNK = 256
MAX_LOG_SCALE = 20
SH_RANGE = 8.0  # width of the range of a coefficient
BOUNDED = ("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b")
COLUMNS = [f"{end}_{name}" for names in BOUNDED for end in ("min", "max") for name in names]
OF_COLORS = COLUMNS[12:]
WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
BITS_OF_POSITION = ((21, 11), (11, 10), (0, 11))  # (shift, bits) of x, y, z
BITS_OF_COLOR = ((24, 8), (16, 8), (8, 8))
BITS_OF_ROTATION = ((20, 10), (10, 10), (0, 10))


def encode(splats: Splats, comments: Sequence[str] = ()) -> bytes:
    """The file of a model, best in an order of neighbours: they share bounds.

    ``comments``: lines for the header.
    """
    n = splats.n_splats
    colors = splats.sh_coeffs[:, 0].astype(np.float64) * C0 + 0.5
    scales = np.clip(splats.log_scales.astype(np.float64), -MAX_LOG_SCALE, MAX_LOG_SCALE)
    bounds, words = [], []
    for values, layout in ((splats.means, BITS_OF_POSITION), (scales, BITS_OF_POSITION), (colors, BITS_OF_COLOR)):
        low, high = _bounds(values)  # [chunks, 3] each
        bounds += [low, high]
        chunk = np.arange(n) // CHUNK
        extent = (high.astype(np.float64) - low)[chunk]  # float32 may hold no difference
        words.append(_packed((values.astype(np.float64) - low[chunk]) / np.where(extent > 0, extent, 1), layout))
    largest, three = smallest_three(unit_quaternions(splats.quats)[:, WXYZ_FROM_XYZW])
    rotations = (largest.astype(np.uint32) << 30) | _packed(three / SQRT2 + 0.5, BITS_OF_ROTATION)
    words[2] |= _packed(splats.opacities[:, None], ((0, 8),))
    positions, packed_scales, packed_colors = words
    k = splats.sh_coeffs.shape[1]
    rest = splats.sh_coeffs[:, 1:].astype(np.float64).transpose(0, 2, 1).reshape(n, 3 * (k - 1))  # channel-major
    sh = np.clip(np.floor((rest / SH_RANGE + 0.5) * 256), 0, 255).astype(np.uint8)
    chunks = np.concatenate(bounds, axis=1)  # [chunks, 18]
    about_rows, rows = trailer.encode(splats)
    header = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in (*comments, *about_rows))]
    header += [f"element chunk {len(chunks)}"]
    header += [f"property float {name}" for name in COLUMNS]
    header += [f"element vertex {n}", *(f"property uint {name}" for name in WORDS)]
    if sh.shape[1]:
        header += [f"element sh {n}", *(f"property uchar f_rest_{i}" for i in range(sh.shape[1]))]
    vertex = np.stack([positions, rotations, packed_scales, packed_colors], axis=1)  # [N, 4]
    text = "\n".join([*header, "end_header\n"]).encode()
    return text + chunks.astype("<f4").tobytes() + vertex.astype("<u4").tobytes() + sh.tobytes() + rows


def read(path: Path) -> Model:
    """The content of a file. Raises ``DataError``."""
    with path.open("rb") as file:
        reader = TableReader(path, file, path.stat().st_size)
        tables = reader.tables({"chunk", "vertex", "sh"}, trailer=True)
        rows = reader.trailer()
    vertex = tables.get("vertex", np.zeros(0))
    n = len(vertex)
    if "chunk" not in tables or not set(WORDS) <= set(vertex.dtype.names or ()):
        reader.fail("no chunks of packed primitives", "give a compressed PLY")
    if any(vertex.dtype[name].kind not in "iu" for name in WORDS):
        reader.fail("its packed words are not integers", "export it again")
    chunks = _chunks(reader, tables["chunk"])
    if len(chunks) * CHUNK < n or len(tables.get("sh", vertex)) != n:
        reader.fail(f"its chunks or spherical harmonics are too few for {counted(n, 'primitive')}")
    bounds = chunks[np.arange(n) // CHUNK]  # [N, what, min or max, axis]

    def between(what: int, word: str, layout: tuple) -> Array:
        share = _unpacked(vertex[word].astype(np.uint32), layout)
        return bounds[:, what, 0] * (1 - share) + bounds[:, what, 1] * share

    colors = between(2, "packed_color", BITS_OF_COLOR)
    rotation = vertex["packed_rotation"].astype(np.uint32)
    three = (_unpacked(rotation, BITS_OF_ROTATION) - 0.5) * SQRT2
    sh = ((colors - 0.5) / C0)[:, None]  # [N, 1, 3]
    if "sh" in tables:
        raw = reader.rest_columns(tables["sh"], "sh")  # [N, 3 (K - 1)]
        middle = np.where(raw == 0, 0, np.where(raw == 255, 1, (raw + 0.5) / 256))
        rest = (middle - 0.5) * SH_RANGE
        sh = np.concatenate([sh, rest.reshape(n, 3, rest.shape[1] // 3).transpose(0, 2, 1)], axis=1)
    splats = Splats(
        means=between(0, "packed_position", BITS_OF_POSITION),
        log_scales=between(1, "packed_scale", BITS_OF_POSITION),
        quats=from_smallest_three(rotation >> 30, three)[:, XYZW_FROM_WXYZ],
        logit_opacities=logits(_unpacked(vertex["packed_color"].astype(np.uint32), ((0, 8),))[:, 0]),
        sh_coeffs=sh,
        **trailer.decode(reader, rows, n),
    )
    return Model(splats, drawing_of(reader.comments), tuple(reader.left_out))


def _chunks(reader: TableReader, table: Array) -> Array:
    """Bounds of each chunk, float64 [chunks, positions or log scales or colours, min or max, axis]; of colours 0 and 1
    in older files, which have none. Raises ``DataError``."""
    there = table.dtype.names or ()
    columns = COLUMNS if set(OF_COLORS) & set(there) else COLUMNS[: -len(OF_COLORS)]
    if missing := [name for name in columns if name not in there]:
        reader.fail(f'its chunks have no property "{missing[0]}"', "export it again")
    bounds = reader.columns(table, "chunk", tuple(columns)).astype(np.float64)
    bounds = bounds.reshape(len(table), len(columns) // 6, 2, 3)
    if len(columns) == len(COLUMNS):
        return bounds
    return np.concatenate([bounds, np.tile([[0.0], [1.0]], (len(table), 1, 1, 3))], axis=1)


def moved(splats: Splats) -> Array:
    """[N] whether a primitive leaves its place by more than its size, beside one far away that shares its bounds.

    In the order of ``in_space``, in which it is written.
    """
    if not splats.n_splats or not np.isfinite(splats.means).all():
        return np.zeros(splats.n_splats, bool)
    order, chunk = in_space(splats), np.arange(splats.n_splats) // CHUNK
    means = splats.means[order].astype(np.float64)
    low, high = (end.astype(np.float64)[chunk] for end in _bounds(means))
    steps = np.array([2**bits - 1 for _, bits in BITS_OF_POSITION])
    extent = np.where(high > low, high - low, 1)
    read = np.empty_like(means)
    read[order] = low + np.round((means - low) / extent * steps) / steps * extent
    return misplaced(splats, read)


def _bounds(values: Array) -> tuple[Array, Array]:
    """float32 [chunks, 3] twice: smallest and largest value [N, 3] of each chunk."""
    starts = np.arange(0, len(values), CHUNK)
    if not len(starts):
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)
    low, high = (f.reduceat(values, starts, axis=0).astype(np.float32) for f in (np.minimum, np.maximum))
    return low, high


def _packed(shares: Array, layout: tuple) -> Array:
    """Values 0..1 [N, C] rounded to ``(shift, bits)`` of each, in one word [N]."""
    word = np.zeros(len(shares), np.uint32)
    for share, (shift, bits) in zip(shares.T, layout, strict=True):
        word |= np.clip(np.floor(share * (2**bits - 1) + 0.5), 0, 2**bits - 1).astype(np.uint32) << np.uint32(shift)
    return word


def _unpacked(word: Array, layout: tuple) -> Array:
    """Values 0..1 [N, C] in words [N]."""
    return np.stack([((word >> np.uint32(shift)) & (2**bits - 1)) / (2.0**bits - 1) for shift, bits in layout], axis=1)
