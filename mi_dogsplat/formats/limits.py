"""Memory in proportion to the file: what is compressed says how much it will become, before it is unpacked."""

from __future__ import annotations

from pathlib import Path

from ..support.errors import DAMAGED, DataError

FREE, RATIO = 16 << 20, 64  # bytes that any file may become, and bytes for each of its own; models become 2 to 20 times


def require_proportion(path: Path, unpacked: int, packed: int) -> None:
    """Raise ``DataError`` if ``packed`` bytes of a file claim to be more than any model compresses to."""
    if unpacked > FREE + RATIO * packed:
        problem = f"{packed} bytes claim to unpack to {unpacked}, which no model compresses to"
        raise DataError(path, problem, DAMAGED)
