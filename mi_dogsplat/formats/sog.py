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
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.splats import Array, Splats
from ..support.errors import DataError
from .packing import SQRT2, from_smallest_three, logits, smallest_three, unit_quats
from .palette import codebook, nearest, palette

FIRST_TAG = 252
PER_ROW = 64  # entries of the palette
MAX_PALETTE = 65536
EPOCH = (1980, 1, 1, 0, 0, 0)  # of the files in the ZIP: the same model gives the same bytes


def encode(splats: Splats) -> bytes:
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

    logs = np.sign(splats.means) * np.log1p(np.abs(splats.means.astype(np.float64)))  # [N, 3]
    low, high = logs.min(axis=0), logs.max(axis=0)
    steps = np.round((logs - low) / np.where(high > low, high - low, 1) * 65535).astype(np.uint16)
    means = {"mins": low.tolist(), "maxs": high.tolist()}
    means["files"] = [store("means_l.webp", steps & 255), store("means_u.webp", steps >> 8)]
    largest, three = smallest_three(unit_quats(splats)[:, [3, 0, 1, 2]])
    quats = np.concatenate([_bytes((three * SQRT2 + 1) / 2), (FIRST_TAG + largest)[:, None]], axis=1)
    sizes, dc = codebook(splats.log_scales), codebook(splats.sh_coeffs[:, 0])
    sh0 = np.concatenate([nearest(dc, splats.sh_coeffs[:, 0]), _bytes(splats.opacities[:, None])], axis=1)
    scales = store("scales.webp", nearest(sizes, splats.log_scales))
    meta: dict[str, Any] = {"version": 2, "asset": {"generator": "mi_dogsplat"}, "count": n, "means": means}
    meta["scales"] = {"codebook": _short(sizes), "files": [scales]}
    meta["quats"] = {"files": [store("quats.webp", quats)]}
    meta["sh0"] = {"codebook": _short(dc), "files": [store("sh0.webp", sh0)]}
    if splats.sh_degree:
        rest = splats.sh_coeffs[:, 1:].reshape(n, -1)  # [N, 3 (K - 1)] red, green, blue of one coefficient in turn
        labels, centroids = palette(rest, palette_size(n))
        table = codebook(centroids)
        entries = nearest(table, centroids)  # [P, 3 (K - 1)]
        order = np.lexsort(entries.T[::-1])  # like ones are neighbours
        labels = np.argsort(order)[labels]
        rows = math.ceil(len(entries) / PER_ROW)
        pixels = np.zeros((rows * PER_ROW, rest.shape[1]), np.uint8)
        pixels[: len(entries)] = entries[order]
        files["shN_centroids.webp"] = _webp(pixels.reshape(rows, -1, 3))
        index = store("shN_labels.webp", np.stack([labels & 255, labels >> 8, 0 * labels], axis=1))
        meta["shN"] = {"count": len(centroids), "bands": splats.sh_degree, "codebook": _short(table)}
        meta["shN"]["files"] = ["shN_centroids.webp", index]
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as bundle:
        bundle.writestr(zipfile.ZipInfo("meta.json", EPOCH), json.dumps(meta, separators=(",", ":")))
        for name, content in files.items():
            bundle.writestr(zipfile.ZipInfo(name, EPOCH), content)
    return buffer.getvalue()


def decode(path: Path) -> Splats:
    """The model in a bundle. Raises ``DataError``."""
    try:
        with zipfile.ZipFile(path) as bundle:
            meta = json.loads(bundle.read("meta.json"))

            def pixels(part: str, which: int = 0) -> Array:
                picture = _pixels(bundle.read(meta[part]["files"][which]))
                return picture.reshape(-1, picture.shape[2])[: meta["count"]]

            dc = np.array(meta["sh0"]["codebook"])
            low, high = np.array(meta["means"]["mins"]), np.array(meta["means"]["maxs"])
            steps = pixels("means", 0)[:, :3] + 256.0 * pixels("means", 1)[:, :3]
            logs = low + (high - low) * steps / 65535
            quats, sh0 = pixels("quats"), pixels("sh0")
            sh = dc[sh0[:, :3]][:, None]  # [N, 1, 3]
            if "shN" in meta:
                entry = _pixels(bundle.read(meta["shN"]["files"][0]))[..., :3]  # [rows, PER_ROW (K - 1), 3]
                entry = entry.reshape(len(entry) * PER_ROW, -1, 3)
                label = pixels("shN", 1).astype(np.int64)
                sh = np.concatenate([sh, np.array(meta["shN"]["codebook"])[entry[label[:, 0] + 256 * label[:, 1]]]], 1)
            wxyz = from_smallest_three(quats[:, 3].astype(np.int64) - FIRST_TAG, (quats[:, :3] / 127.5 - 1) / SQRT2)
            return Splats(
                means=np.sign(logs) * np.expm1(np.abs(logs)),
                log_scales=np.array(meta["scales"]["codebook"])[pixels("scales")[:, :3]],
                quats=wxyz[:, [1, 2, 3, 0]],
                logit_opacities=logits(sh0[:, 3] / 255),
                sh_coeffs=sh,
            )
    except (OSError, zipfile.BadZipFile, KeyError, ValueError, IndexError) as error:
        raise DataError(path, f"is no SOG bundle ({error})", "export it again") from error


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
    Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, "WEBP", lossless=True, quality=100, method=6, exact=True)
    return buffer.getvalue()


def _pixels(data: bytes) -> Array:
    from PIL import Image

    with Image.open(io.BytesIO(data)) as picture:
        return np.asarray(picture.convert("RGBA"))  # an opaque one may have lost its alpha
