"""What an SPZ file is wrapped in: one gzip stream up to version 3, a Zstandard stream for each attribute in version 4.

Version 4: a header of 32 bytes, records of extensions, and from ``table`` on a table of two 64-bit sizes a stream,
compressed and not, before the streams themselves. Attributes are the same bytes in the same order as in version 3.

Specification: the README of github.com/nianticlabs/spz (MIT).
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..support.errors import DAMAGED, DataError
from .limits import require_proportion

MAGIC = 0x5053474E
HEADER = struct.Struct("<IIIBBBB")  # magic, version, primitives, SH degree, fraction bits, flags, streams
TABLE = struct.Struct("<I12x")  # of version 4, after the header: offset of the table
SIZES = struct.Struct("<QQ")
EXTENSIONS = 2  # flag: records of extensions follow
MAX_DEGREE = 4
FIXED, FEXTRA, FNAME, FCOMMENT = 10, 4, 8, 16  # bytes of the header of gzip, and flags of its optional fields
GZIP, NGSP = b"\x1f\x8b", b"NGSP"
ATTRIBUTES = ("positions", "opacities", "colors", "scales", "rotations", "sh")
PIECE = 1 << 16  # bytes that are read at a time, of what is not kept
LEVEL = 12  # of Zstandard, as the reference encoder's


@dataclass(frozen=True)
class Payload:
    """Header and attributes of a file, by the names in ``ATTRIBUTES``."""

    version: int
    n: int
    degree: int
    fraction_bits: int
    flags: int
    attributes: dict[str, bytes]
    comments: tuple[str, ...] = ()  # lines in the header of gzip


def attribute_sizes(version: int, degree: int) -> dict[str, int]:
    """Bytes of each attribute, for a primitive."""
    positions, rotations = 6 if version == 1 else 9, 3 if version < 3 else 4
    return dict(zip(ATTRIBUTES, (positions, 1, 3, 3, rotations, 3 * ((degree + 1) ** 2 - 1)), strict=True))


def unwrapped(path: Path, data: bytes) -> Payload:
    """The payload of a file of version 1 to 4. Raises ``DataError``."""
    if data[:4] == NGSP:
        return _streams(path, data)
    if data[:2] != GZIP:
        raise DataError(path, "is not an SPZ file: it begins neither with gzip nor with NGSP", DAMAGED)
    try:
        inflate = zlib.decompressobj(16 + zlib.MAX_WBITS)
        head = inflate.decompress(data, HEADER.size)
        if head[:3] == b"ply":
            raise DataError(path, "is a PLY that was packed with gzip", "unpack it")
        magic, version, n, degree, bits, flags, _ = HEADER.unpack(head)
        _check(path, magic, version, degree, (1, 2, 3))
        sizes = attribute_sizes(version, degree)
        need = n * sum(sizes.values())
        require_proportion(path, need, len(data))
        body = inflate.decompress(inflate.unconsumed_tail, need) if need else b""
        if len(body) == need:
            _to_the_end(path, inflate, need, len(data))
    except (zlib.error, struct.error) as error:
        raise DataError(path, f"its gzip stream holds no SPZ data ({error})", DAMAGED) from error
    if len(body) != need:
        raise DataError(path, f"{n} primitives need {need} bytes, the gzip stream has {len(body)}", DAMAGED)
    attributes, at = {}, 0
    for name, size in sizes.items():
        attributes[name] = body[at : at + n * size]
        at += n * size
    return Payload(version, n, degree, bits, flags, attributes, tuple(_comment(data).splitlines()))


def _to_the_end(path: Path, inflate: Any, before: int, packed: int) -> None:
    """Read on to the check sum of a gzip stream, which zlib compares with all that was read. Raises ``DataError``.

    Args:
        before: bytes that it has given so far; records of extensions may follow.
        packed: bytes of the file.
    """
    while not inflate.eof:
        more = inflate.decompress(inflate.unconsumed_tail, PIECE)
        if not more and not inflate.eof:
            raise DataError(path, "its gzip stream ends before its check sum", DAMAGED)
        before += len(more)
        require_proportion(path, before, packed)


def with_comment(data: bytes, comment: str) -> bytes:
    """A gzip stream without optional fields, as zlib writes it, with a comment in its header (RFC 1952)."""
    return data[:3] + bytes([FCOMMENT]) + data[4:FIXED] + comment.encode("latin-1") + b"\0" + data[FIXED:]


def _comment(data: bytes) -> str:
    """The comment in the header of a gzip stream; empty where there is none."""
    flags, at = data[3], FIXED
    if not flags & FCOMMENT:
        return ""
    if flags & FEXTRA:
        at += 2 + int.from_bytes(data[at : at + 2], "little")
    if flags & FNAME:
        at = data.index(b"\0", at) + 1
    return data[at : data.index(b"\0", at)].decode("latin-1")


def rewrapped(path: Path, data: bytes) -> bytes:
    """A file of version 3 as one of version 4. Raises ``DataError``, also where the package zstandard is missing."""
    payload, zstandard = unwrapped(path, data), zstandard_for(path)
    packer = zstandard.ZstdCompressor(level=LEVEL)
    sizes = attribute_sizes(payload.version, payload.degree)
    raw = [content for name, content in payload.attributes.items() if sizes[name]]
    streams = [packer.compress(content) for content in raw]
    header = HEADER.pack(MAGIC, 4, payload.n, payload.degree, payload.fraction_bits, payload.flags, len(streams))
    table = b"".join(SIZES.pack(len(stream), len(content)) for stream, content in zip(streams, raw, strict=True))
    return header + TABLE.pack(HEADER.size + TABLE.size) + table + b"".join(streams)


def _streams(path: Path, data: bytes) -> Payload:
    try:
        magic, version, n, degree, bits, flags, count = HEADER.unpack_from(data)
        (at,) = TABLE.unpack_from(data, HEADER.size)
        _check(path, magic, version, degree, (4,))
        sizes = [SIZES.unpack_from(data, at + i * SIZES.size) for i in range(count)]
    except struct.error as error:
        raise DataError(path, f"ends within its header ({error})", DAMAGED) from error
    at += count * SIZES.size
    wanted = [(name, n * size) for name, size in attribute_sizes(version, degree).items()]
    missing = len(wanted) - count
    if missing == 1 and not wanted[-1][1]:  # no stream for no spherical harmonics
        wanted.pop()
        missing = 0
    if missing > 0 or at + sum(packed for packed, _ in sizes) > len(data):
        raise DataError(path, f"its table of {count} streams does not fit its {len(data)} bytes", DAMAGED)
    require_proportion(path, sum(need for _, need in wanted), len(data))
    zstandard, attributes = zstandard_for(path), {"sh": b""}
    for (name, need), (packed, unpacked) in zip(wanted, sizes, strict=False):  # others come after those known here
        stream = data[at : at + packed]
        at += packed
        if unpacked != need:
            raise DataError(path, f"{n} primitives need {need} bytes of {name}, the table has {unpacked}", DAMAGED)
        try:
            content = zstandard.ZstdDecompressor().stream_reader(stream).read(need + 1) if need else b""
        except zstandard.ZstdError as error:
            raise DataError(path, f"its stream of {name} cannot be unpacked ({error})", DAMAGED) from error
        if len(content) != need:
            raise DataError(path, f"{n} primitives need {need} bytes of {name}, the stream has {len(content)}", DAMAGED)
        attributes[name] = content
    return Payload(version, n, degree, bits, flags, attributes)


def _check(path: Path, magic: int, version: int, degree: int, versions: tuple[int, ...]) -> None:
    if magic != MAGIC:
        raise DataError(path, "is not an SPZ file: its header does not begin with NGSP", DAMAGED)
    if version not in versions:
        in_gzip = "pack it with gzip, which versions 1 to 3 are in"  # a browser may have unpacked it
        remedies = dict.fromkeys((1, 2, 3), in_gzip) | {4: "unpack it: only versions 1 to 3 are in gzip"}
        remedy = remedies.get(version, "convert it to a version from 1 to 4")
        raise DataError(path, f"is SPZ of version {version}", remedy)
    if degree > MAX_DEGREE:
        raise DataError(path, f"has spherical harmonics of degree {degree}, there are 0 to {MAX_DEGREE}", DAMAGED)


def zstandard_for(path: Path) -> Any:
    """The package that version 4 needs. Raises ``DataError`` where it is missing."""
    try:
        import zstandard  # here: version 4 alone needs it
    except ImportError:
        remedy = "pip install 'mi_dogsplat[export]', or use version 3"
        raise DataError(path, "SPZ 4 needs the package zstandard", remedy) from None
    return zstandard
