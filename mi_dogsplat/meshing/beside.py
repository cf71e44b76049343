"""Files beside that of a mesh, which hold its texture: what they are called, and what they may take the place of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from ..support.errors import DataError, writing
from ..support.files import write_bytes

MARK = b"made by mi_dogsplat"  # in each of them: such a one may be replaced
OBJ = ".obj"
HEAD = 4096  # bytes of a file, among which the mark is


def picture_beside(path: Path) -> Path:
    """The picture of a mesh that has none inside of its file: another one for each format, as two of them may lie side
    by side, of two meshes."""
    suffix = path.suffix.lower()
    return path.with_name(f"{path.stem}{'' if suffix == OBJ else suffix.replace('.', '_')}_texture.jpg")


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
                problem = "exists, is no texture of an earlier mesh, and would be lost"
                raise DataError(file, problem, "move it, or give the mesh another name")


@contextmanager
def written_beside(beside: Mapping[Path, bytes]) -> Iterator[None]:
    """Write files beside one that is written here; if that cannot be, those that are new are not left, and others are
    as they were, those of an earlier mesh."""
    before = {file: file.read_bytes() if file.exists() else None for file in beside}
    try:
        for file, content in beside.items():
            write_bytes(file, content)
        yield
    except DataError:
        for file, content in before.items():
            if content is None:
                file.unlink(missing_ok=True)
            else:
                with suppress(DataError):  # of a disk that is full: what went wrong first is told
                    write_bytes(file, content)
        raise
