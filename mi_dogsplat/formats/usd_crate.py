"""Binary OpenUSD ("crate") looked over before the library opens it: what it claims to hold is in proportion to it.

The library allocates as many tokens, fields, paths and specs as a file names, and asks for no proof: one wrong byte can
take minutes and all memory. The table of contents is at the end of the file, and each of its sections begins with a
count. Arrays of values, and what points where, are not looked at (docs/trust.md says what that may do).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from ..support.errors import DAMAGED, DataError
from .limits import require_proportion

HEAD = struct.Struct("<8sBB6xq")  # magic, version (major, minor), where the table of contents is
PACKED = (0, 4)  # the version since which lists are compressed
SECTION = struct.Struct("<16sqq")  # name, start, size
NUMBER = struct.Struct("<Q")
EACH = {"TOKENS": 16, "STRINGS": 8, "FIELDS": 16, "FIELDSETS": 8, "PATHS": 16, "SPECS": 16}  # bytes in memory, at least
COMPRESSED = {"FIELDS": 2, "FIELDSETS": 1, "PATHS": 3, "SPECS": 3}  # lists of integers that follow the count
MOST_SECTIONS = 64


@dataclass(frozen=True)
class _Part:
    """So many bytes of a file from ``first`` on."""

    file: BinaryIO
    first: int
    size: int

    def read(self, numbers: struct.Struct, at: int, end: int | None = None) -> tuple[Any, ...]:
        """Numbers at a byte, before ``end``. Raises ``ValueError`` where they are not within."""
        end = self.size if end is None else end
        if not 0 <= at <= end - numbers.size:
            raise ValueError(f"it names byte {at} of {end}")
        self.file.seek(self.first + at)
        return numbers.unpack(self.file.read(numbers.size))


def require_sound(path: Path, file: BinaryIO, first: int, size: int) -> None:
    """Raise ``DataError`` about ``path`` where a crate, of so many bytes from ``first`` on, claims what no file of its
    size can hold."""
    part = _Part(file, first, size)
    try:
        _, *version, at = part.read(HEAD, 0)
        packed = tuple(version) >= PACKED
        (sections,) = part.read(NUMBER, at)
        if sections > MOST_SECTIONS:
            raise ValueError(f"it has {sections} sections")
        claimed = 0
        for k in range(sections):
            name, start, length = part.read(SECTION, at + NUMBER.size + k * SECTION.size)
            known = name.rstrip(b"\0").decode("latin-1")
            claimed += _claimed(part, known, start, start + length, packed) if known in EACH else 0
    except (struct.error, ValueError, OSError) as error:
        raise DataError(path, f"is not a binary OpenUSD file ({error})", DAMAGED) from error
    require_proportion(path, claimed, size)


def _claimed(part: _Part, name: str, start: int, end: int, packed: bool) -> int:
    """Bytes that a section would take in memory. Raises ``ValueError`` where its lists are longer than it is."""
    if not 0 <= start <= end <= part.size:
        raise ValueError(f"its section {name} is at bytes {start} to {end} of {part.size}")
    (count,), at = part.read(NUMBER, start, end), start + NUMBER.size
    if not packed or not count:
        return count * EACH[name]
    if name == "TOKENS":  # then the size of their text
        return count * EACH[name] + part.read(NUMBER, at, end)[0]
    if name == "PATHS":  # says its count twice
        count, at = max(count, part.read(NUMBER, at, end)[0]), at + NUMBER.size
    for _ in range(COMPRESSED.get(name, 0)):
        (length,) = part.read(NUMBER, at, end)
        at += NUMBER.size + length
        if at > end:
            raise ValueError(f"a list of its section {name} is longer than that")
    return count * EACH[name]
