"""How files of photographs are called, by their format, in lower or upper case."""

from __future__ import annotations

from . import exr, heif

PLAIN = (".png", ".jpg", ".jpeg", ".bmp", ".gif", ".tif", ".tiff", ".webp", ".ppm")  # as masks are, too
NEWER = (".avif", ".jxl")  # Pillow reads neither of them everywhere
RAW = (
    ".dng", ".cr2", ".cr3", ".crw", ".nef", ".nrw", ".arw", ".sr2", ".raf", ".orf", ".rw2", ".rwl", ".srw", ".pef",
    ".3fr", ".fff", ".iiq", ".x3f", ".gpr", ".mrw", ".erf", ".dcr", ".kdc",
)  # fmt: skip
PHOTOGRAPHS = (*PLAIN, *heif.SUFFIXES, *NEWER, *RAW, exr.SUFFIX)
