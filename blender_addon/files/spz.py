"""Models as SPZ files (Niantic), versions 1 to 3: one gzip stream of quantised attributes.

The same format as ``mi_dogsplat.formats.spz``, which documents it; this copy keeps the add-on free of other packages.
Version 4 needs Zstandard, and so the package.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from .errors import FileError
from .model import GROUPS, Model, logit

GZIP = b"\x1f\x8b"
ANTIALIASED = 1  # flag
_HEADER = struct.Struct("<IIIBBBB")  # magic, version, splats, SH degree, fraction bits, flags, reserved
_MAGIC = 0x5053474E
_FREE, _MOST = 16 << 20, 64  # bytes that any file may become, and times its own: no model is compressed to less
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])  # components beside the largest
# SPZ is in axes right, up, back; files of 3DGS are in right, down, forward. Signs of the basis functions of SH:
_SIGNS = np.array([1, -1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1])
_AGAIN = "copy or export the file again"
_VERSION = "not SPZ of version 1, 2 or 3, but {version}"


def gzip_comments(head: bytes) -> list[str]:
    """Lines of the comment in the header of a gzip stream (RFC 1952), where a linear model says that it is."""
    at = 10
    if head[3] & 4:
        at += 2 + int.from_bytes(head[at : at + 2], "little")
    if head[3] & 8:
        at = head.find(b"\0", at) + 1
    return head[at : head.find(b"\0", at)].decode("latin-1").splitlines() if head[3] & 16 else []


def read_spz(path: str | Path) -> tuple[Model, bool]:
    """Read a model in the axes of 3DGS PLY, and whether it is antialiased. Raises ``FileError``."""
    path = Path(path)
    try:
        data = path.read_bytes()
        inflate = zlib.decompressobj(16 + zlib.MAX_WBITS)
        magic, version, n, degree, bits, flags, _ = _HEADER.unpack(inflate.decompress(data, _HEADER.size))
        if magic != _MAGIC:
            raise FileError(path, "is not an SPZ file: its header does not begin with NGSP", _AGAIN)
        if version not in (1, 2, 3):
            raise FileError(path, _VERSION, "convert it to PLY", version=version)
        if degree > 4:
            problem = "has spherical harmonics of degree {degree}, there are 0 to 4"
            raise FileError(path, problem, _AGAIN, degree=degree)
        sizes = (6 if version == 1 else 9, 1, 3, 3, 3 if version < 3 else 4, 3 * ((degree + 1) ** 2 - 1))
        need = n * sum(sizes)
        if need > _FREE + _MOST * len(data):
            raise FileError(path, "{size} bytes cannot hold {n} splats", _AGAIN, size=len(data), n=n)
        body = inflate.decompress(inflate.unconsumed_tail, need) if need else b""
        if len(body) == need:
            _to_the_end(path, inflate, len(data))
    except OSError as error:
        remedy = "check the path and its permissions"
        raise FileError(path, "cannot be read ({reason})", remedy, reason=error.strerror) from error
    except (zlib.error, struct.error) as error:
        raise FileError(path, "no gzip stream of an SPZ file ({reason})", _AGAIN, reason=error) from error
    if len(body) != need:
        problem = "{n} splats need {need} bytes, the file has {size}"
        raise FileError(path, problem, _AGAIN, n=n, need=need, size=len(body))
    ends = np.cumsum([0, *sizes]) * n
    parts = [np.frombuffer(body[a:b], np.uint8) for a, b in zip(ends, ends[1:], strict=False)]
    positions, opacities, colors, scales, rotations, rest = parts
    means = _floats(path, positions) if version == 1 else _fixed(positions, bits)
    sh = np.concatenate([(colors.reshape(n, 1, 3) / 255 - 0.5) / 0.15,
                         (rest.reshape(n, (degree + 1) ** 2 - 1, 3)[:, :15] - 128.0) / 128], axis=1)  # fmt: skip
    quats = _first_three(rotations) if version < 3 else _smallest_three(rotations)
    model = Model(
        means=(means * [1, -1, -1]).astype(np.float32),
        log_scales=(scales.reshape(n, 3) / 16 - 10).astype(np.float32),
        quats=(quats[:, [3, 0, 1, 2]] * [1, 1, -1, -1]).astype(np.float32),
        logit_opacities=logit(np.clip(opacities / 255, 1e-6, 1 - 1e-6)),
        sh_coeffs=(sh * _SIGNS[: sh.shape[1], None]).astype(np.float32),
        is_dog=np.zeros(n, bool),
        dog_logit_opacities=np.zeros(n, np.float32),
        dog_log_scales=np.zeros((n, 3), np.float32),
        **{name: values for group in GROUPS for name, values in group.of_none(n).items()},
    )
    return model, bool(flags & ANTIALIASED)


def _to_the_end(path: Path, inflate: Any, size: int) -> None:
    """Read on to the check sum of a gzip stream of ``size`` bytes, which zlib compares with all that was read."""
    left = _FREE + _MOST * size  # bytes: records of extensions may follow
    while not inflate.eof and left > 0:
        more = inflate.decompress(inflate.unconsumed_tail, 1 << 16)
        left -= len(more)
        if not more:
            break
    if not inflate.eof:
        raise FileError(path, "its gzip stream ends before its check sum", _AGAIN)


def _floats(path: Path, raw: np.ndarray) -> np.ndarray:
    """Positions [N, 3] of version 1. Raises ``FileError``."""
    means = raw.view("<f2").reshape(-1, 3).astype(np.float64)
    if not np.isfinite(means).all():
        raise FileError(path, "a position is not finite", _AGAIN)
    return means


def _fixed(raw: np.ndarray, bits: int) -> np.ndarray:
    """Positions [N, 3] of later versions, of whose 24 bits some are the fraction."""
    fixed = np.zeros((len(raw) // 9, 3, 4), np.uint8)
    fixed[..., 1:] = raw.reshape(-1, 3, 3)
    return (fixed.view("<i4")[..., 0] >> 8) / 2.0**bits


def _first_three(raw: np.ndarray) -> np.ndarray:
    """Quaternions [N, 4] (x, y, z, w) of which x, y and z are stored, with w >= 0."""
    xyz = raw.reshape(-1, 3) / 127.5 - 1
    return np.concatenate([xyz, np.sqrt(np.maximum(0, 1 - (xyz**2).sum(axis=1, keepdims=True)))], axis=1)


def _smallest_three(raw: np.ndarray) -> np.ndarray:
    """Quaternions [N, 4] (x, y, z, w) without their largest component, whose index is on top."""
    words = raw.view("<u4")[:, None]
    parts = (words >> np.array([20, 10, 0], np.uint32)) & 1023
    three = np.where(parts >> 9, -1, 1) * (parts & 511) / (511 * np.sqrt(2))
    largest = (words >> 30).astype(np.int64)  # [N, 1]
    quats = np.zeros((len(words), 4))
    np.put_along_axis(quats, _OTHERS[largest[:, 0]], three, axis=1)
    np.put_along_axis(quats, largest, np.sqrt(np.maximum(0, 1 - (three**2).sum(axis=1, keepdims=True))), axis=1)
    return quats
