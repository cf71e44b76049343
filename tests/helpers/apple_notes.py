"""The maker note of phones by Apple, byte by byte."""

import struct


def apple_note(acceleration, front: bool = False, order: str = ">", kind: int = 10, count: int = 3) -> bytes:
    """A maker note: its name, a version, the order of bytes, and a directory with offsets from its beginning; the
    acceleration is ``count`` values of a ``kind`` of TIFF's."""
    tags = [(0x45, 9, 1, int(front)), (1, 9, 1, 4), (8, kind, count, None), (9, 10, 3, 0)]
    head = b"Apple iOS\0\0\1" + {">": b"MM", "<": b"II"}[order] + struct.pack(f"{order}H", len(tags))
    after = len(head) + 12 * len(tags) + 4
    for tag, its_kind, its_count, value in tags:
        head += struct.pack(f"{order}HHII", tag, its_kind, its_count, after if value is None else value)
    parts = [part for value in acceleration for part in (round(value * 10_000), 10_000)]
    return head + b"\0" * 4 + struct.pack(f"{order}6i", *parts)
