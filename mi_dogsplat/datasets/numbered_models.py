"""The models ``sparse/0``, ``sparse/1``, ... of a data set: COLMAP writes one for each part of a capture that it could
not connect with the others, and we read the first."""

from __future__ import annotations

from pathlib import Path

from ..support.wording import counted
from .colmap import find_model, is_model, model_file
from .colmap_files import read_images


def numbered_models(path: Path) -> list[Path]:
    """Their folders, in the order of their numbers; none where there is no such folder."""
    found = [folder for folder in path.glob("sparse/*") if folder.name.isdecimal() and is_model(folder)]
    return sorted(found, key=lambda folder: int(folder.name))


def other_models(path: Path) -> list[str]:
    """A line for each that is not read, where one is. Raises ``DataError``."""
    model, numbered = find_model(path), numbered_models(path)
    if model not in [folder.resolve() for folder in numbered]:
        return []
    n_read, lines = _n_images(model), []
    for folder in numbered:
        if folder.resolve() != model:
            n = _n_images(folder)
            instead = f": give {folder} to read it instead" if n > n_read else ""
            other = f"sparse/{folder.name}, another model of COLMAP's, of {counted(n, 'image')}"
            lines.append(f"{other}; the one that is read has {n_read}{instead}")
    return lines


def _n_images(model: Path | None) -> int:
    file = model_file(model, "images") if model else None
    return len(read_images(file)) if file else 0
