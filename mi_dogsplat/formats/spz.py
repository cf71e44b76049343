"""SPZ, version 3 (Niantic): a gzip stream of quantised attributes, one after the other, in RUB axes.

====================  =====================================================================================
positions             24-bit fixed point, little-endian; the header tells how many bits are the fraction
opacities             8 bits
colours               8 bits of 0.15 f_dc + 0.5
scales                8 bits of 16 (log scale + 10): steps of 6 %, from e^-10 to e^5.94
rotations             32 bits: smallest three of (x, y, z, w) as sign and 9 bits, index of the largest on top
SH of degree 1 to 3   8 bits of 128 f_rest + 128, in the order of coefficients, then channels
====================  =====================================================================================

The reference encoder rounds SH further, to 5 and 4 bits, which compresses better but costs a compact model 1.5 dB
(docs/export.md): not done here. Version 3 is what readers have in common: 4 came later, 2 has coarser rotations.

Specification: the README of github.com/nianticlabs/spz (MIT). Own code: no package of it installs everywhere by pip.
"""

from __future__ import annotations

import gzip
import math
import struct
from pathlib import Path

import numpy as np

from ..scene.splats import Array, Splats
from ..support.errors import DataError
from .packing import SQRT2, from_smallest_three, logits, smallest_three, unit_quats

MAGIC, VERSION = 0x5053474E, 3
HEADER = struct.Struct("<IIIBBBB")  # magic, version, primitives, SH degree, fraction bits, flags, reserved
ANTIALIASED = 1  # flag
FRACTION_BITS = 12  # of a position, as in the reference encoder: a quarter of a millimetre where a unit is a metre
COLOR_SCALE = 0.15
MAGNITUDES = 511  # of a component of a quaternion, 9 bits


def encode(splats: Splats, antialiased: bool = False) -> bytes:
    """The file of a model of plain Gaussians that is in RUB axes; values out of range are clamped."""
    n, degree = splats.n_splats, splats.sh_degree
    bits = fraction_bits(splats.means)
    fixed = np.round(splats.means.astype(np.float64) * 2**bits)
    fixed = np.clip(fixed, -(2**23), 2**23 - 1).astype("<i4")  # [N, 3]
    positions = fixed.view(np.uint8).reshape(n, 3, 4)[..., :3]
    colors = splats.sh_coeffs[:, 0] * (COLOR_SCALE * 255) + 127.5
    largest, three = smallest_three(unit_quats(splats))
    magnitudes = np.minimum(MAGNITUDES, np.abs(three) * SQRT2 * MAGNITUDES + 0.5).astype(np.uint32)
    parts = ((three < 0).astype(np.uint32) << 9) | magnitudes  # [N, 3]
    rotations = (largest.astype(np.uint32) << 30) | (parts[:, 0] << 20) | (parts[:, 1] << 10) | parts[:, 2]
    attributes = [
        positions,
        _bytes(splats.opacities * 255),
        _bytes(colors),
        _bytes((splats.log_scales + 10) * 16),
        rotations.astype("<u4"),
        _bytes(splats.sh_coeffs[:, 1:] * 128 + 128),
    ]
    header = HEADER.pack(MAGIC, VERSION, n, degree, bits, ANTIALIASED if antialiased else 0, 0)
    return gzip.compress(header + b"".join(a.tobytes() for a in attributes), mtime=0)


def decode(path: Path) -> Splats:
    """The model in a file of version 3, in RUB axes. Raises ``DataError``."""
    try:
        data = gzip.decompress(path.read_bytes())
        magic, version, n, degree, bits, _, _ = HEADER.unpack_from(data)
    except (OSError, EOFError, struct.error) as error:
        raise DataError(path, f"is no gzip stream of an SPZ file ({error})", "export it again") from error
    sizes = {"positions": 9, "opacities": 1, "colors": 3, "scales": 3, "rotations": 4}
    sizes["sh"] = 3 * ((degree + 1) ** 2 - 1)
    if (magic, version) != (MAGIC, VERSION) or degree > 3 or len(data) != HEADER.size + n * sum(sizes.values()):
        raise DataError(path, f"is no SPZ file of version {VERSION}, or damaged", "export it again")
    raw, offset = {}, HEADER.size
    for name, size in sizes.items():
        raw[name] = np.frombuffer(data, np.uint8, n * size, offset).reshape(n, size)
        offset += n * size
    fixed = np.zeros((n, 3, 4), np.uint8)
    fixed[..., 1:] = raw["positions"].reshape(n, 3, 3)
    positions = (fixed.view("<i4")[..., 0] >> 8) / 2.0**bits  # the shift spreads the sign
    packed = raw["rotations"].copy().view("<u4")  # [N, 1]
    parts = (packed >> np.array([20, 10, 0], np.uint32)) & 1023  # [N, 3]
    three = np.where(parts >> 9, -1, 1) * (parts & MAGNITUDES) / (MAGNITUDES * SQRT2)
    sh = np.concatenate([(raw["colors"][:, None] / 255 - 0.5) / COLOR_SCALE,
                         (raw["sh"].reshape(n, -1, 3) - 128.0) / 128], axis=1)  # fmt: skip
    return Splats(
        means=positions,
        log_scales=raw["scales"] / 16 - 10,
        quats=from_smallest_three(packed[:, 0] >> 30, three),
        logit_opacities=logits(raw["opacities"][:, 0] / 255),
        sh_coeffs=sh,
    )


def fraction_bits(means: Array) -> int:
    """Bits of the fraction that leave room for all positions [N, 3]; the reference's 12 where they do."""
    reach = float(np.abs(means).max(initial=0))
    return max(0, min(FRACTION_BITS, 23 - math.frexp(reach)[1]))


def _bytes(values: Array) -> Array:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)

