"""Where the images of a model of COLMAP's lie: by their names, or by what other tools make of these.

COLMAP names images by their paths below ``images``. Others write ``images/`` before them, or backslashes between
folders, or the path that an image once had, of which the 3DGS loader, and so what is made for it, looks at the last
part alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from .images import is_file, named_file


def image_files(folder: Path, names: Sequence[str]) -> list[Path]:
    """Files in ``folder`` of images of these names, in their order, whether they are there or not.

    Names are spelt in the way in which most are found. By the last parts of their paths images are found only where no
    two have the same.
    """
    files = [named_file(folder, name) for name in names]
    if any(is_file(path) for path in files):
        return files
    paths = [PurePosixPath(name.replace("\\", "/")) for name in names]
    below = [path.relative_to("images") if path.is_relative_to("images") else path for path in paths]
    ways = [files, *([named_file(folder, path) for path in way] for way in (paths, below, _last_parts(paths)))]
    return max(ways, key=lambda way: sum(is_file(path) for path in way))


def _last_parts(paths: list[PurePosixPath]) -> list[PurePosixPath]:
    """Of paths, if all of them differ; else the same paths."""
    last = [PurePosixPath(path.name) for path in paths]
    return last if len(set(last)) == len(last) else paths
