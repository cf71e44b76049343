"""Memory in proportion to the file: what is compressed says how much it will become, before it is unpacked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields
from pathlib import Path

from ..scene.splats import Array
from ..support.errors import DAMAGED, DataError
from .model import Model

FREE, RATIO = 16 << 20, 64  # bytes that any file may become, and bytes for each of its own; models become 2 to 20 times


def require_proportion(path: Path, unpacked: int, packed: int) -> None:
    """Raise ``DataError`` if ``packed`` bytes of a file claim to be more than any model compresses to."""
    if unpacked > FREE + RATIO * packed:
        problem = f"{packed} bytes claim to unpack to {unpacked}, which no model compresses to"
        raise DataError(path, problem, DAMAGED)


def in_proportion(found: Iterable[tuple[Model, Array]], packed: int) -> Iterator[tuple[Model, Array]]:
    """Models of a scene with their matrices, one by one; a scene of ``packed`` bytes may name one again and again.

    Raises ``ValueError`` as soon as they are out of proportion.
    """
    left = FREE + RATIO * packed
    for model, matrix in found:
        left -= sum(getattr(model.splats, field.name).nbytes for field in fields(model.splats))
        if left < 0:
            raise ValueError("its parts repeat more primitives than it has bytes for")
        yield model, matrix
