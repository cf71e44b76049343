"""Reader of COLMAP's model files (cameras, images, points3D, frames; binary and text).

A parser of our own instead of pycolmap 4.2.1, for two measured reasons. It weighs little to write, and
pycolmap weighs 36 MiB as a wheel and 135 MiB installed (0.4 s to import). And pycolmap trusts its input: a
truncated ``cameras.bin`` loads without a word with repeated bytes as intrinsics, a truncated ``points3D.bin``
was still busy after 60 s behind a C++ stack trace. Here every read is checked against the size of the file.
pycolmap is the oracle of the tests.

Format: COLMAP's documentation, "Output Format". Poses are read from ``images``, which COLMAP keeps writing
beside the newer ``rigs`` and ``frames``; of these only which images are of one frame.
"""

from __future__ import annotations

from pathlib import Path

from . import colmap_binary, colmap_text
from .colmap_records import ColmapCamera, ColmapImage, ColmapPoints


def read_cameras(path: Path) -> dict[int, ColmapCamera]:
    """Cameras by id from ``cameras.bin`` or ``cameras.txt``. Raises ``DataError``, also for a lens that is not known
    here."""
    return _reader(path).cameras(path)


def read_images(path: Path) -> list[ColmapImage]:
    """Registered images from ``images.bin`` or ``images.txt``, in file order. Raises ``DataError``."""
    return _reader(path).images(path)


def read_points(path: Path) -> ColmapPoints:
    """Sparse points from ``points3D.bin`` or ``points3D.txt``, ordered by id. Raises ``DataError``."""
    return _reader(path).points(path)


def read_frames(path: Path) -> dict[int, int]:
    """The ids of frames by those of their images, from ``frames.bin`` or ``frames.txt``: images of one frame were taken
    at one moment by a rig. Raises ``DataError``."""
    return _reader(path).frames(path)


def _reader(path: Path):
    return colmap_binary if path.suffix == ".bin" else colmap_text
