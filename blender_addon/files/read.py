"""Models of every format: PLY and SPZ by readers of our own, all others by the package, which makes a PLY of them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from .errors import FileError
from .light import spz_radiance
from .model import Model
from .ply import read_comments, read_ply
from .said import Said, said_in
from .spz import GZIP, gzip_comments, read_spz

HEAD = 1 << 16  # bytes that are looked at first: comments may be long
USD = (".usd", ".usda", ".usdc", ".usdz")
EXTENSIONS = (".ply", ".spz", ".sog", ".glb", ".gltf", *USD, ".splat", ".json")  # .json: the meta.json of SOG
Converter = Callable[[Path, Path], None]  # any model to a PLY, DoG and comments kept; raises ``FileError``


def read_model(path: str | Path, convert: Converter) -> tuple[Model, Said]:
    """Read a model of any format. Raises ``FileError``; ``convert`` is asked for what is neither PLY nor SPZ 1 to 3."""
    path = Path(path)
    if path.is_dir():
        raise FileError(path, "this is a folder", "give the path of a model")
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
    except OSError as error:
        remedy = "check the path and its permissions"
        raise FileError(path, "cannot be read ({reason})", remedy, reason=error.strerror) from error
    if head[:2] == GZIP:
        model, antialiased = read_spz(path)
        comments = gzip_comments(head)
        said = replace(said_in(comments), antialiased=antialiased)
        return spz_radiance(model, said.light, comments) if said.linear else model, said
    is_ply, packed = head[:3] == b"ply", b"packed_position" in head.partition(b"end_header")[0]
    if (is_ply and not packed) or (path.suffix.lower() == ".ply" and not is_ply):  # its reader knows what is wrong
        return read_ply(path), said_in(read_comments(path))
    with tempfile.TemporaryDirectory(prefix="dogsplat_") as folder:
        plain = Path(folder) / "model.ply"
        convert(path, plain)
        return read_ply(plain), said_in(read_comments(plain))
