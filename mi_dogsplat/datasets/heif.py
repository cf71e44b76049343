"""Photographs in HEIF, as phones (HEIC) and cameras (HIF) write them: opened by pillow-heif, of the extra ``poses``.

Whoever reads such a file turns its pixels as the file says (ISO/IEC 23008-12), so they come upright. EXIF may say the
same once more, and is not asked.
"""

from __future__ import annotations

from typing import BinaryIO

from PIL import Image

FORMAT = "HEIF"  # as Pillow calls it
SUFFIXES = (".heic", ".heif", ".hif")  # in lower or upper case
BRANDS = (b"heic", b"heix", b"heim", b"heis", b"mif1")  # of a single picture; those of sequences are no photographs


def is_heif(head: bytes) -> bool:
    """Whether a file begins with these bytes, 12 of them at least."""
    return head[4:8] == b"ftyp" and head[8:12] in BRANDS


def opened(file: BinaryIO) -> Image.Image:
    """The main picture of a file, whose pixels are not read yet. Raises what Pillow raises for bad files, and
    ``ModuleNotFoundError`` where the extra is not installed."""
    from pillow_heif import HeifImageFile

    return HeifImageFile(file)


def orientation_of(image: Image.Image) -> int:
    """EXIF's orientation before the pixels were turned upright; 1 of upright ones, and of other formats."""
    return image.info.get("original_orientation") or 1


def code_of(image: Image.Image) -> tuple[int, int] | None:
    """(primaries, transfer function) of a HEIF file, as ISO/IEC 23091-2 numbers them; None where it names none."""
    said = image.info.get("nclx_profile")
    return (said["color_primaries"], said["transfer_characteristics"]) if said else None
