"""Checkpoints: the whole state of a run in one file of plain arrays (no pickle), written whole or not at all."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from ..errors import DataError
from ..files import replacing


def save_checkpoint(path: Path, state: dict[str, np.ndarray]) -> None:
    """Write arrays by name; an earlier checkpoint stays in place until this one is complete."""
    with replacing(path) as part, open(part, "wb") as file:
        np.savez(file, **state)  # type: ignore[arg-type]


def load_checkpoint(path: Path) -> dict[str, np.ndarray]:
    """Read what ``save_checkpoint`` wrote. Raises ``DataError`` if the file is missing or damaged."""
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise DataError(path, "there is no checkpoint", "train without --resume") from None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        raise DataError(path, "is not a readable checkpoint", "train without --resume") from None
