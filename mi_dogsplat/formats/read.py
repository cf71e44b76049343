"""Reading a model of any format, which is recognised by the first bytes of the file, or else by its name."""

from __future__ import annotations

import codecs
import stat
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..scene.ply_tables import NOT_FINITE
from ..scene.radiance import brightened
from ..support.arguments import checks_arguments
from ..support.errors import DataError, writing
from ..support.files import parse_json, require_place, written_file
from . import gltf_container, sog_read, spz_container, usd_read
from .folders import folder_given
from .model import Model, require_finite
from .packing import turned
from .table import COMPRESSED_PLY, FORMATS, GLB, GLTF, PLY, SOG, SPLAT, SPZ, USD, Format, read_any_ply
from .usd_files import is_usd

HEAD = 1 << 16  # bytes that are looked at first: comments of a PLY may be long
COMPRESSED = b"packed_position"  # in the header of that kind of PLY
ZIP, DEFLATED = b"PK\x03\x04", spz_container.GZIP + b"\x08"  # the only method that gzip has
MODEL_NAMES = f"a model ({' '.join(FORMATS)}, or the {sog_read.META} of SOG)"


@checks_arguments
def read_model(path: str | Path, finite: bool = True) -> Model:
    """Read a model of any format in ``FORMATS``, in the axes of 3DGS PLY, and how it is to be drawn.

    ``finite``: numbers that are not finite are an error; else they are left as they are.

    Raises ``DataError`` for whatever is no model; memory stays in proportion to the file.
    """
    path = Path(path)
    try:
        chosen = format_of(path)
        with np.errstate(all="ignore"):  # what is not finite is found below
            model = chosen.read(path) if finite or chosen is not PLY else read_any_ply(path)
            if chosen.in_white and model.drawing.linear and model.drawing.white:
                model = replace(model, splats=brightened(model.splats, model.drawing.white))
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror})", "check the path and its permissions") from error
    if finite:
        require_finite(path, model.splats, NOT_FINITE)
    return model if chosen.turn is None else replace(model, splats=turned(model.splats, chosen.turn))


def size_of(path: Path) -> int:
    """Bytes of the files of a model that was read. Raises ``OSError``."""
    return sum(file.stat().st_size for file in files_of(path))


def files_of(path: Path) -> list[Path]:
    """The file of a model that was read, and the files beside it that it names: the pictures of a SOG that is no
    bundle, the buffers of a .gltf, the layers of an OpenUSD. Raises ``OSError``."""
    chosen, beside = format_of(path), []
    if chosen is SOG:
        beside = sog_read.files_beside(path)
    elif chosen in (GLB, GLTF):
        beside = gltf_container.Container.open(path).files_beside()
    elif chosen is USD:
        beside = usd_read.files_beside(path)
    return [file for file in (path, *beside) if file.is_file()]


def read_source(path: Path, out: Path, verb: str, finite: bool = True) -> Model:
    """Read the model that ``out`` is to be made of: it is another file, has primitives, and ``out`` can be written.

    Args:
        verb: what is to be done with it, for the remedy.
        finite: as in ``read_model``.

    Raises ``DataError``.
    """
    model = read_model(path, finite)
    if out.exists() and any(out.samefile(file) for file in files_of(path)):
        raise DataError(out, "is the model itself, or a part of it, which would be lost", "name another file")
    require_primitives(path, model, verb)
    require_writable(out)
    return model


def require_primitives(path: Path, model: Model, verb: str) -> None:
    """Raise ``DataError`` for an empty model, of which nothing can be made; ``verb`` is what was to be done with it."""
    if model.splats.n_splats == 0:
        raise DataError(path, "the model is empty", f"{verb} one that has primitives")


def require_writable(out: Path) -> None:
    """Raise ``DataError`` where a file cannot be made: said before what takes long."""
    if out.is_dir():
        raise DataError(out, "is a folder", "name a file in it")
    with writing(out):
        folder = written_file(out).parent
    if not folder.is_dir():
        problem = f"leads into {folder}, which is no folder" if out.is_symlink() else "there is no such folder"
        raise DataError(out, f"cannot be written ({problem})", "make it, or name another one")
    require_place(out)


def is_model_name(path: Path) -> bool:
    """Whether a name is that of a model, of whatever format."""
    return path.name.lower() == sog_read.META or any(path.name.lower().endswith(suffix) for suffix in FORMATS)


def format_of(path: Path) -> Format:
    """What a file is, by its content first. Raises ``DataError`` and ``OSError``."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):  # opening a pipe would wait for ever
        if stat.S_ISDIR(status.st_mode):
            raise folder_given(path, sorted(file for file in path.iterdir() if _holds_primitives(file)), MODEL_NAMES)
        raise DataError(path, "this is not a regular file", f"give the path of {MODEL_NAMES}")
    head = _head(path)
    if found := _by_content(path, head):
        return found
    if path.suffix.lower() == ".splat":  # has no first bytes of its own
        return SPLAT
    for suffix, chosen in FORMATS.items():  # its reader knows best what is wrong
        if path.name.lower().endswith(suffix):
            return PLY if chosen is COMPRESSED_PLY else chosen
    raise DataError(path, "is not a model of a known format", f"give {MODEL_NAMES}")


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(HEAD)


def _holds_primitives(path: Path) -> bool:
    """Whether a file has the name of a model, and is no PLY of points or a mesh."""
    if not is_model_name(path) or not path.is_file():
        return False
    head = _head(path) if path.suffix.lower() == ".ply" else b""
    return not head or b"opacity" in head or COMPRESSED in head.partition(b"end_header")[0]


def _by_content(path: Path, head: bytes) -> Format | None:
    if head[:4] in (b"ply\n", b"ply\r"):
        return COMPRESSED_PLY if COMPRESSED in head.partition(b"end_header")[0] else PLY
    if head[:4] == gltf_container.MAGIC.to_bytes(4, "little"):
        return GLB
    if head[:3] == DEFLATED or head[:4] == spz_container.NGSP:
        return SPZ
    if is_usd(head):
        return USD
    if head[:4] == ZIP:
        return SOG
    if head.removeprefix(codecs.BOM_UTF8).lstrip()[:1] == b"{" and path.suffix.lower() != ".gltf" and _is_text(head):
        return SOG if path.name.lower() == sog_read.META or is_sog_meta(path) else GLB
    return None


def _is_text(head: bytes) -> bool:
    """Whether bytes begin a text: the first number of one .splat in 256 begins as a JSON does."""
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # a character may be cut off at the end
    except UnicodeDecodeError:
        return False
    return b"\0" not in head


def is_sog_meta(path: Path) -> bool:
    """Whether a JSON file is that of SOG; whoever reads it says what is wrong with one that is broken."""
    try:
        content = parse_json(path.read_text(encoding="utf-8-sig"))
    except ValueError:
        return False
    return isinstance(content, dict) and "means" in content
