"""SOG, version 2 (PlayCanvas): attributes as pixels of lossless WebP pictures, bundled in a ZIP with their meta.json.

A primitive is the same pixel of every picture. ``means_l``, ``means_u``: lower and upper byte of 16 bits between
bounds, of sign(x) ln(1 + |x|). ``quats``: smallest three of (w, x, y, z) as 8 bits, 252 + the largest's index in alpha.
``scales``, ``sh0``: indices into a table of 256 log scales, and of 256 f_dc; the alpha of ``sh0`` is the opacity.
``shN``: ``labels`` name an entry (16 bits) of a palette, whose coefficients are pixels of ``centroids``, 64 entries a
row, and indices into a third table. Numbers are in the axes of 3DGS PLY, as the readers of this format take them.

Specification: developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from typing import Any

import numpy as np

from ..scene.drawing import EXTRAS, Drawing
from ..scene.quaternions import WXYZ_FROM_XYZW, unit_quaternions
from ..scene.sh_basis import C0
from ..scene.splats import Array, Splats
from ..support.srgb import linear_to_srgb_log, srgb_log_to_linear
from .packing import SQRT2, misplaced, signed_exp, signed_log, smallest_three
from .palette import CODES, codebook, nearest, palette
from .sog_read import FIRST_TAG, PER_ROW

MAX_PALETTE = 65536
LAST = 65535  # code of a coordinate
EPOCH = (1980, 1, 1, 0, 0, 0)  # of the files in the ZIP: the same model gives the same bytes


def encode(splats: Splats, drawing: Drawing = Drawing()) -> bytes:
    """The file of a model of plain Gaussians, best in an order of neighbours: pictures of it are smaller."""
    n = splats.n_splats
    files: dict[str, bytes] = {}
    width = max(4, math.ceil(math.sqrt(n) / 4) * 4)
    height = max(4, math.ceil(n / width / 4) * 4)

    def store(name: str, rows: Array) -> str:
        pixels = np.zeros((width * height, rows.shape[1]), np.uint8)
        pixels[:n] = rows
        files[name] = _webp(pixels.reshape(height, width, -1))
        return name

    steps, low, high = _places(splats.means)
    means = {"mins": low.tolist(), "maxs": high.tolist()}
    means["files"] = [store("means_l.webp", steps & 255), store("means_u.webp", steps >> 8)]
    largest, three = smallest_three(unit_quaternions(splats.quats)[:, WXYZ_FROM_XYZW])
    quats = np.concatenate([_bytes((three * SQRT2 + 1) / 2), (FIRST_TAG + largest)[:, None]], axis=1)
    sizes, (dc, indices) = codebook(splats.log_scales), _colors(splats.sh_coeffs[:, 0], bool(drawing.linear))
    sh0 = np.concatenate([indices, _bytes(splats.opacities[:, None])], axis=1)
    scales = store("scales.webp", nearest(sizes, splats.log_scales))
    meta: dict[str, Any] = {"version": 2, "asset": {"generator": "mi_dogsplat"}, "count": n, "means": means}
    if drawing.antialiased is not None:
        meta["antialias"] = drawing.antialiased
    if said := drawing.said():
        meta["extras"] = {EXTRAS: said}
    meta["scales"] = {"codebook": _short(sizes), "files": [scales]}
    meta["quats"] = {"files": [store("quats.webp", quats)]}
    meta["sh0"] = {"codebook": _short(dc), "files": [store("sh0.webp", sh0)]}
    if splats.sh_degree and n:
        labels, entries, table = _view_dependent(splats.sh_coeffs[:, 1:].reshape(n, -1))
        files["shN_centroids.webp"] = _webp(_in_rows(entries))
        index = store("shN_labels.webp", np.stack([labels & 255, labels >> 8, 0 * labels], axis=1))
        meta["shN"] = {"count": len(entries), "bands": splats.sh_degree, "codebook": _short(table)}
        meta["shN"]["files"] = ["shN_centroids.webp", index]
    return _bundled(meta, files)


def moved(splats: Splats) -> Array:
    """[N] whether a primitive leaves its place by more than its size, as one far away spreads the bounds."""
    if not splats.n_splats or not np.isfinite(splats.means).all():
        return np.zeros(splats.n_splats, bool)
    steps, low, high = _places(splats.means)
    logs = low + (high - low) * steps / LAST
    return misplaced(splats, signed_exp(logs))


def _places(means: Array) -> tuple[Array, Array, Array]:
    """Codes uint16 [N, 3] of centres [N, 3], and the bounds [3] of their logarithms, between which they lie."""
    logs = signed_log(means.astype(np.float64))  # [N, 3]
    low, high = (end(logs, axis=0) if len(logs) else np.zeros(3) for end in (np.min, np.max))
    return np.round((logs - low) / np.where(high > low, high - low, 1) * LAST).astype(np.uint16), low, high


def _view_dependent(rest: Array) -> tuple[Array, Array, Array]:
    """(labels [N], entries [P, 3 (K - 1)] of the palette as indices into a table, the table [256]) of the coefficients
    [N, 3 (K - 1)], red, green, blue of one in turn."""
    labels, centroids = palette(rest, palette_size(len(rest)))
    table = codebook(centroids)
    entries = nearest(table, centroids)
    order = np.lexsort(entries.T[::-1])  # like ones are neighbours
    return np.argsort(order)[labels], entries[order], table


def _in_rows(entries: Array) -> Array:
    """The palette [P, 3 (K - 1)] as the pixels of its picture."""
    rows = math.ceil(len(entries) / PER_ROW)
    pixels = np.zeros((rows * PER_ROW, entries.shape[1]), np.uint8)
    pixels[: len(entries)] = entries
    return pixels.reshape(rows, -1, 3)


def _bundled(meta: dict[str, Any], files: dict[str, bytes]) -> bytes:
    """A ZIP of a meta.json and pictures, which are not compressed again."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as bundle:
        bundle.writestr(zipfile.ZipInfo("meta.json", EPOCH), json.dumps(meta, separators=(",", ":")))
        for name, content in files.items():
            bundle.writestr(zipfile.ZipInfo(name, EPOCH), content)
    return buffer.getvalue()


def _colors(dc: Array, linear: bool) -> tuple[Array, Array]:
    """Table [256] of f_dc, and indices into it of [N, 3].

    Of linear colours, in units of white, it is made through the tone curve: else lamps would take all of its entries.
    """
    if not linear or len(np.unique(dc)) <= CODES:  # the values themselves
        table = codebook(dc)
        return table, nearest(table, dc)
    seen = linear_to_srgb_log(0.5 + C0 * dc.astype(np.float64))
    table = codebook(seen)
    return ((srgb_log_to_linear(table) - 0.5) / C0).astype(np.float32), nearest(table, seen)


def palette_size(n: int) -> int:
    """Entries for N primitives: a half to all of them, in whole kilos, up to what 16 bits can name."""
    return min(MAX_PALETTE, 1024 * 2 ** max(0, int(n // 1024).bit_length() - 1))


def _bytes(shares: Array) -> Array:
    return np.round(np.clip(shares, 0, 1) * 255).astype(np.uint8)


def _short(values: Array) -> list[float]:
    """float32 as the shortest decimals that are read as the same float32."""
    return [float(str(value)) for value in values]


def _webp(pixels: Array) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    # exact: else colours under an alpha of 0 would be lost
    Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, "WEBP", lossless=True, quality=100, exact=True)
    return buffer.getvalue()
