"""Files of OpenUSD: their names and first bytes, whether they hold what they claim, and the library that they need.

The library, Pixar's usd-core, is loaded where a file needs it. That of another program, such as Blender's, does as
well: nothing here asks for classes of the schemas of particle fields, which OpenUSD has had since 26.03.
"""

from __future__ import annotations

import os
import shutil
import struct
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from ..support.errors import DAMAGED, DataError
from . import usd_crate

TEXT, BINARY, PACKAGE = ".usda", ".usdc", ".usdz"
NAMES = (".usd", TEXT, BINARY, PACKAGE)
MAGICS = (b"PXR-USDC", b"#usda ")
ZIP, LENGTHS_AT, NAME_AT = b"PK\x03\x04", 26, 30  # of a file in a package: bytes from its header on
ARGUMENTS = ":SDF_FORMAT_ARGS:"  # what the library takes the rest of a name for


def require_package(path: Path) -> None:
    """Raise ``DataError`` where the library is missing, or cannot be told the path of a file."""
    try:
        import pxr  # noqa: F401

        os.path.abspath(path).encode()
    except ImportError:
        raise DataError(path, "OpenUSD needs the package usd-core", "pip install 'mi_dogsplat[usd]'") from None
    except UnicodeEncodeError:
        raise DataError(path, "its path is not UTF-8, which OpenUSD needs", "rename it") from None


def is_usd(head: bytes) -> bool:
    """Whether a file is OpenUSD, by its first bytes."""
    length = int.from_bytes(head[26:28], "little")
    first = head[NAME_AT : NAME_AT + length].lower()
    return head.startswith(MAGICS) or head.startswith(ZIP) and first.endswith(tuple(name.encode() for name in NAMES))


def require_sound(path: Path) -> None:
    """Raise ``DataError`` where a binary file, or the first one in a package, is not what it claims to be."""
    with path.open("rb") as file:
        places = [(0, path.stat().st_size)]
        if file.read(len(ZIP)) == ZIP:
            places = _places(path, file)
        for start, size in places:
            file.seek(start)
            if file.read(len(MAGICS[0])) == MAGICS[0]:
                usd_crate.require_sound(path, file, start, size)


def _places(path: Path, file: BinaryIO) -> list[tuple[int, int]]:
    """(first byte, size) of each file in a package, which compresses none. Raises ``DataError``."""
    found = []
    try:
        with zipfile.ZipFile(file) as package:
            for entry in package.infolist():
                if entry.compress_type != zipfile.ZIP_STORED:
                    raise zipfile.BadZipFile("a file in it is compressed")
                file.seek(entry.header_offset + LENGTHS_AT)
                of_name, of_extra = struct.unpack("<HH", file.read(4))
                found.append((entry.header_offset + NAME_AT + of_name + of_extra, entry.file_size))
    except (zipfile.BadZipFile, struct.error, ValueError, NotImplementedError, OSError) as error:
        raise DataError(path, f"is not an OpenUSD package ({error})", DAMAGED) from error
    return found


@contextmanager
def named_by_content(path: Path) -> Iterator[Path]:
    """The file, or a copy of it that has the name which the library goes by, where its own is that of something else.

    What a copy references beside it is not found, as ``left_out`` says then.
    """
    with path.open("rb") as file:
        head = file.read(len(MAGICS[0]))
    kind = PACKAGE if head.startswith(ZIP) else BINARY if head == MAGICS[0] else TEXT
    well_named = path.name.lower().endswith((kind, *NAMES[:1] * (kind != PACKAGE)))
    well_named = well_named and ARGUMENTS not in os.path.abspath(path)
    if well_named or not head.startswith((*MAGICS, ZIP)):
        yield path
        return
    with TemporaryDirectory(prefix="dogsplat-") as folder:
        yield Path(shutil.copyfile(path, Path(folder) / f"model{kind}"))


def reason(error: Exception) -> str:
    """What the library says of an error first."""
    try:
        return next((part.commentary for part in error.args if hasattr(part, "commentary")), "no reason is given")
    except UnicodeDecodeError:  # it quotes the file
        return "it has text that is not UTF-8"
