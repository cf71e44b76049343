"""Whether there is memory for a picture: asked before it is drawn, as Dr.Jit ends a process that has too little."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import mitsuba as mi

from ..support.errors import DataError
from ..support.memory import available_memory
from ..support.wording import file_size

BYTES = {".exr": 130, ".npz": 90}  # of a pixel, by the kind of file, with depth and no further channels
BYTES_OF_OTHERS = 75
ASKED_FROM = 5e8  # bytes: a smaller picture costs no look


def require_memory(place: str | Path, width: int, height: int, suffix: str, remedy: str) -> None:
    """Raise ``DataError`` where pictures of this size, for files of this kind, take more memory than is free.

    Only on a CPU: a GPU has memory of its own.
    """
    needed = width * height * BYTES.get(suffix, BYTES_OF_OTHERS)
    if needed < ASKED_FROM or not (mi.variant() or "").startswith("llvm"):
        return
    free = None
    with suppress(ModuleNotFoundError):  # the package that knows it belongs to the extras
        free = available_memory()
    if free is not None and needed > free:
        taken = f"{width:,} x {height:,} pixels would take {file_size(needed)} of memory"
        raise DataError(place, f"{taken}, and {file_size(free)} are free", remedy)
