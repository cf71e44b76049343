"""Folders with a file for each image, named like the image: masks, and depth maps.

The file of ``left/1.JPG`` is ``left/1.png``, or another format, or ``left/1.JPG.png``, as COLMAP has it, or
``left_1.png``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable
from pathlib import Path
from unicodedata import normalize

from ..support.errors import DataError
from .dataset import IMAGES, view_name
from .photograph_names import PHOTOGRAPHS

SAME_SHAPE = 0.02  # relative difference of the ratios of two sizes that are of one shape


def composed(name: str) -> str:
    """A name by which files and images are told, with letters and their marks in one: macOS takes them apart."""
    return normalize("NFC", name)


def files_like_images(folder: Path, suffixes: Collection[str], kind: str) -> dict[str, Path]:
    """The files of a folder that end in one of the ``suffixes``, by the ``composed`` names of the views that they are
    of; ``kind`` is the word for one of them.

    Where some lie beside a folder ``images``, as in that of a data set, what lies in this are its photographs. Raises
    ``DataError`` for two of one view: one of them may be the photograph, and nothing tells which.
    """
    paths: dict[str, Path] = {}
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in suffixes)
    beside = [path for path in found if not re.fullmatch(IMAGES, path.relative_to(folder).parts[0])]
    found = beside or found
    names = [_views_of(path.relative_to(folder)) for path in found]
    for path, (likely, _) in zip(found, names, strict=True):
        if other := paths.get(likely):
            problem = f'would be a second {kind} of "{likely}", besides {other.relative_to(folder)}'
            raise DataError(path, problem, f"remove one of them; photographs and {kind}s belong in different folders")
        paths[likely] = path
    for path, (_, itself) in zip(found, names, strict=True):
        paths.setdefault(itself, path)
    return paths


def line_on_lacking(folder: Path, files: Collection[str], views: Iterable[str], kind: str, so: str) -> list[str]:
    """A line on those views, by their names, of which ``files_like_images`` found none in the folder, as where files
    are named otherwise, and what follows; none where all have one."""
    names = sorted(views)
    lacking = [name for name in names if composed(name) not in files]
    said = f"{folder}: no {kind} for {len(lacking)} of {len(names)} images"
    return [f"{said}, such as {lacking[0]}; {so}"] if lacking else []


def folder_named_like(file: Path, view: str) -> Path | None:
    """The folder in which a file is found for a view; None where it is named otherwise."""
    return next((above for above in file.parents if composed(view) in _views_of(file.relative_to(above))), None)


def require_same_way(path: Path, size: tuple[int, int], image: tuple[int, int]) -> None:
    """Raise ``DataError`` for a file that stands where its image lies, by their widths and heights: it is of the image
    as EXIF turns it, and stretched to its size it would say something of other pixels."""
    across, of_file = (math.log(width / height) for width, height in (image, size))
    if abs(across) > 2 * SAME_SHAPE and abs(across + of_file) < SAME_SHAPE:
        problem = f"is {size[0]}x{size[1]}, turned by 90° against its image, {image[0]}x{image[1]}"
        raise DataError(path, problem, "turn it to match the pixels as stored in the image file")


def _views_of(file: Path) -> tuple[str, str]:
    """The ``composed`` names of the views that a file may be of, by its path in the folder, the likelier one first: an
    image may itself be called 1.jpg.png."""
    image = file.with_suffix("") if Path(file.stem).suffix.lower() in PHOTOGRAPHS else file
    return composed(view_name(str(image))), composed(view_name(str(file)))
