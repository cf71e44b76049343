"""Files beside that of a mesh, which hold its texture: what they are called, and what they may take the place of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from ..support.errors import DataError, writing
from ..support.files import write_bytes

MARK = b"made by mi_dogsplat"  # in each of them: such a one may be replaced
HEAD = 4096  # bytes of a file, among which the mark is


def picture_beside(path: Path) -> Path:
    """The picture of a mesh that has none inside of its file: that of OBJ is called by the mesh alone, any other by its
    format as well, as meshes of one name may have different textures."""
    format_of = "" if path.suffix.lower() == ".obj" else path.suffix.replace(".", "_")
    return path.with_name(f"{path.stem}{format_of}_texture.jpg")


def material_beside(path: Path) -> Path:
    """What an OBJ names, and which names the picture."""
    return path.with_suffix(".mtl")


def require_ours(*files: Path) -> None:
    """Raise ``DataError`` for one that is there and was not made by a mesh: nobody has named it, and it would be
    lost."""
    for file in files:
        if file.exists():
            with writing(file), file.open("rb") as there:
                ours = MARK in there.read(HEAD)
            if not ours:
                problem = "is there, is no texture of an earlier mesh, and would be lost"
                raise DataError(file, problem, "move it, or give the mesh another name")


@contextmanager
def written_beside(beside: Mapping[Path, bytes]) -> Iterator[None]:
    """Write files beside one that is written here; if that cannot be, those that are new are not left."""
    new = [file for file in beside if not file.exists()]
    try:
        for file, content in beside.items():
            write_bytes(file, content)
        yield
    except DataError:
        for file in new:
            file.unlink(missing_ok=True)
        raise
