"""SPZ (Niantic), version 3: a gzip stream of quantised attributes, one after another, in RUB axes; 1 to 4 are read.

====================  =====================================================================================
positions             24-bit fixed point, little-endian; the header tells how many bits are the fraction
opacities             8 bits
colours               8 bits of 0.15 f_dc + 0.5
scales                8 bits of 16 (log scale + 10): steps of 6 %, from e^-10 to e^5.94
rotations             32 bits: smallest three of (x, y, z, w) as sign and 9 bits, index of the largest on top
SH of degree 1 to 3   8 bits of 128 f_rest + 128, in the order of coefficients, then channels
====================  =====================================================================================

How a model of linear radiance is drawn is said in the comment of the gzip header (RFC 1952), which readers skip. Its
f_dc are what a screen would show: through the sRGB curve up to white, above through a logarithm that ends with code 255
at ``LINEAR_BRIGHTEST``. The comment says that too; without it, as in files of before, they are radiance.

The reference encoder rounds SH further, to 5 and 4 bits, which compresses better but costs a compact model 1.5 dB
(docs/export.md): not done here. Version 3 is what readers have in common: 4 came later (``spz_container.py``), 2 has
coarser rotations, x, y and z of 8 bits each, and so has 1, whose positions are 16-bit floats.

Specification: the README of github.com/nianticlabs/spz (MIT). Own code: what was looked at, see
docs/export_details.md.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..scene.drawing import Drawing, comments_of, drawing_of
from ..scene.quaternions import unit_quaternions
from ..scene.sh_basis import C0, SH_LEFT_OUT
from ..scene.splats import Array, Splats
from ..support.srgb import linear_to_srgb_log, srgb_log_to_linear
from .grids import Extents, Steps
from .model import Model
from .packing import SQRT2, from_smallest_three, logits, misplaced, smallest_three
from .spz_container import EXTENSIONS, HEADER, MAGIC, Payload, unwrapped, with_comment

VERSION = 3  # that is written
ANTIALIASED = 1  # flag
FRACTION_BITS = 12  # of a position, as in the reference encoder: a quarter of a millimetre where a unit is a metre
MOST_BITS = 30  # readers shift a 32-bit 1 by them
COLOR_SCALE = 0.15
BRIGHTEST = 0.5 + C0 * 0.5 / COLOR_SCALE  # colour of code 255
LOG_SCALES = -10.0, 255 / 16 - 10  # of codes 0 and 255
LINEAR_BRIGHTEST = 1024.0  # of linear models, in units of white
FLATTER = (BRIGHTEST - 1) / float(linear_to_srgb_log(LINEAR_BRIGHTEST) - 1)  # slope above white, of the tone curve's
COLORS = 1 - BRIGHTEST, BRIGHTEST  # of codes 0 and 255
RADIANCE = float(srgb_log_to_linear(COLORS[0])), LINEAR_BRIGHTEST
CURVE = "dogsplat curve srgb_log"
MAX_SH_SIZE = 16  # coefficients of degree 3
GZIP, MEMORY = 31, 9  # of zlib: its largest window with the header of gzip, its largest tables
MAGNITUDES = 511  # of a component of a quaternion, 9 bits


def encode(splats: Splats, drawing: Drawing = Drawing()) -> bytes:
    """The file of a model of plain Gaussians that is in RUB axes; values out of range are clamped."""
    n, degree = splats.n_splats, splats.sh_degree
    bits = fraction_bits(splats)
    fixed = _fixed(splats, bits)  # [N, 3]
    positions = fixed.view(np.uint8).reshape(n, 3, 4)[..., :3]
    sh, log_scales = (values.astype(np.float64) for values in (splats.sh_coeffs, splats.log_scales))
    dc = shown(sh[:, 0]) if drawing.linear else sh[:, 0]
    colors = dc * (COLOR_SCALE * 255) + 127.5
    largest, three = smallest_three(unit_quaternions(splats.quats))
    magnitudes = np.minimum(MAGNITUDES, np.abs(three) * SQRT2 * MAGNITUDES + 0.5).astype(np.uint32)
    parts = ((three < 0).astype(np.uint32) << 9) | magnitudes  # [N, 3]
    rotations = (largest.astype(np.uint32) << 30) | (parts[:, 0] << 20) | (parts[:, 1] << 10) | parts[:, 2]
    attributes = [
        positions,
        _bytes(splats.opacities * 255),
        _bytes(colors),
        _bytes((log_scales + 10) * 16),
        rotations.astype("<u4"),
        _bytes(sh[:, 1:] * 128 + 128),
    ]
    header = HEADER.pack(MAGIC, VERSION, n, degree, bits, ANTIALIASED if drawing.antialiased else 0, 0)
    said = [*comments_of(Drawing(linear=True, white=drawing.white)), CURVE] if drawing.linear else []
    return _gzip([header, *(a.tobytes() for a in attributes)], "\n".join(said))


def read(path: Path) -> Model:
    """The content of a file of version 1 to 4, in RUB axes. Raises ``DataError``."""
    return content_of(path, path.read_bytes())


def content_of(path: Path, data: bytes) -> Model:
    """What ``read`` returns of these bytes; ``path`` is for its errors."""
    payload = unwrapped(path, data)
    n = payload.n
    raw = {name: np.frombuffer(part, np.uint8).reshape(n, -1) for name, part in payload.attributes.items() if part}
    empty = np.zeros((n, 0), np.uint8)
    sh = raw.get("sh", empty).reshape(n, (payload.degree + 1) ** 2 - 1, 3)[:, : MAX_SH_SIZE - 1]
    dc = (raw.get("colors", empty).reshape(n, 1, 3) / 255 - 0.5) / COLOR_SCALE
    splats = Splats(
        means=_positions(payload),
        log_scales=raw.get("scales", empty).reshape(n, 3) / 16 - 10,
        quats=_rotations(payload),
        logit_opacities=logits(raw.get("opacities", empty).reshape(n) / 255),
        sh_coeffs=np.concatenate([radiance(dc) if CURVE in payload.comments else dc, (sh - 128.0) / 128], axis=1),
    )
    left_out = [SH_LEFT_OUT] if payload.degree > 3 else []
    left_out += ["records of extensions"] if payload.flags & EXTENSIONS else []
    drawing = replace(drawing_of(payload.comments), antialiased=bool(payload.flags & ANTIALIASED))
    return Model(splats, drawing, tuple(left_out))


def shown(dc: Array) -> Array:
    """f_dc of what a screen shows of linear f_dc."""
    curved = linear_to_srgb_log(0.5 + C0 * dc.astype(np.float64))
    return (np.where(curved > 1, 1 + (curved - 1) * FLATTER, curved) - 0.5) / C0


def radiance(dc: Array) -> Array:
    """The inverse of ``shown``."""
    curved = 0.5 + C0 * dc
    return (srgb_log_to_linear(np.where(curved > 1, 1 + (curved - 1) / FLATTER, curved)) - 0.5) / C0


def _positions(payload: Payload) -> Array:
    """[N, 3]; version 1 has 16-bit floats."""
    raw = payload.attributes["positions"]
    if payload.version == 1:
        return np.frombuffer(raw, "<f2").reshape(-1, 3)
    fixed = np.zeros((payload.n, 3, 4), np.uint8)
    fixed[..., 1:] = np.frombuffer(raw, np.uint8).reshape(-1, 3, 3)
    return (fixed.view("<i4")[..., 0] >> 8) / 2.0**payload.fraction_bits  # the shift spreads the sign


def _rotations(payload: Payload) -> Array:
    """Unit quaternions [N, 4]; versions 1 and 2 have x, y and z of those with w >= 0, 8 bits each."""
    raw = payload.attributes["rotations"]
    if payload.version < 3:
        xyz = np.frombuffer(raw, np.uint8).reshape(-1, 3) / 127.5 - 1
        return np.concatenate([xyz, np.sqrt(np.maximum(0, 1 - (xyz**2).sum(axis=1, keepdims=True)))], axis=1)
    packed = np.frombuffer(raw, "<u4")[:, None]  # [N, 1]
    parts = (packed >> np.array([20, 10, 0], np.uint32)) & 1023  # [N, 3]
    three = np.where(parts >> 9, -1, 1) * (parts & MAGNITUDES) / (MAGNITUDES * SQRT2)
    return from_smallest_three(packed[:, 0] >> 30, three)


def fraction_bits(splats: Splats) -> int:
    """Bits of the fraction of positions: the reference's 12, fewer where positions leave no room for them.

    More where primitives are so small that 12 would move them: one more than their grid has, which was made before
    their last sizes were known.
    """
    if splats.n_splats == 0:
        return FRACTION_BITS
    return max(0, min(_wanted_bits(splats), _room(splats)))


def moved(splats: Splats) -> Array:
    """[N] whether a primitive leaves its place by more than its size, where positions leave no room for finer ones."""
    if splats.n_splats == 0 or _room(splats) >= _wanted_bits(splats):
        return np.zeros(splats.n_splats, bool)
    bits = fraction_bits(splats)
    return misplaced(splats, _fixed(splats, bits) / 2.0**bits)


def _fixed(splats: Splats, bits: int) -> Array:
    """Codes of positions, int32 [N, 3]."""
    return np.clip(np.round(splats.means.astype(np.float64) * 2**bits), -(2**23), 2**23 - 1).astype("<i4")


def _wanted_bits(splats: Splats) -> int:
    """Of the fraction, with whatever room."""
    grid = math.ceil(-math.log2(max(Steps.position * Extents.of(splats).small, 2.0**-MOST_BITS)))
    return min(max(FRACTION_BITS, grid + 1), MOST_BITS)


def _room(splats: Splats) -> int:
    """Bits that the largest coordinate leaves."""
    return 23 - math.frexp(float(np.abs(splats.means).max()))[1]


def _gzip(parts: list[bytes], comment: str = "") -> bytes:
    """One stream, in which every part has codes of its own: 2 % smaller than where they begin anywhere."""
    stream = zlib.compressobj(zlib.Z_BEST_COMPRESSION, zlib.DEFLATED, GZIP, MEMORY)
    whole = b"".join(stream.compress(part) + stream.flush(zlib.Z_BLOCK) for part in parts) + stream.flush()
    return with_comment(whole, comment) if comment else whole


def _bytes(values: Array) -> Array:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)
