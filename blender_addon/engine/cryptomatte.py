"""Names as Cryptomatte writes them (Psyop, "Cryptomatte specification 1.2.0")."""

from __future__ import annotations

import struct
from collections.abc import Iterable

MASK = 0xFFFFFFFF


def murmur3(data: bytes) -> int:
    """MurmurHash3_x86_32 of seed 0 (Appleby)."""
    value = 0
    for start in range(0, len(data), 4):
        block = data[start : start + 4]
        k = int.from_bytes(block, "little") * 0xCC9E2D51 & MASK
        value ^= (k << 15 | k >> 17) * 0x1B873593 & MASK
        if len(block) == 4:
            value = ((value << 13 | value >> 19) & MASK) * 5 + 0xE6546B64 & MASK
    value ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        value = (value ^ value >> shift) * factor & MASK
    return value ^ value >> 16


def _bits_of(name: str) -> int:
    """The hash as bits of a number that is neither denormal, infinite nor NaN: its exponent is moved inside."""
    bits = murmur3(name.encode())
    return bits ^ 1 << 23 if bits >> 23 & 255 in (0, 255) else bits


def float_of(name: str) -> float:
    """What stands for a name in the pixels."""
    return struct.unpack("<f", struct.pack("<I", _bits_of(name)))[0]


def manifest(names: Iterable[str]) -> dict[str, str]:
    """Which name has which bits."""
    return {name: f"{_bits_of(name):08x}" for name in names}


def key_of(layer: str) -> str:
    """Seven digits for a layer."""
    return f"{murmur3(layer.encode()):08x}"[:7]
