"""OpenUSD files by Pixar's own library (usd-core): opened without a word on the terminal, and written whole.

The library is loaded where a file needs it. That of another program, such as Blender's, does as well: nothing here asks
for classes of the schemas of particle fields, which OpenUSD has had since 26.03.
"""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

from __future__ import annotations

import errno
import math
import os
import shutil
import struct
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from ..scene.splats import Array
from ..support.errors import DAMAGED, DataError, writing
from ..support.files import replacing
from ..support.wording import printable
from .usd_crate import require_sound

if TYPE_CHECKING:
    from pxr import Usd, UsdGeom

TEXT, BINARY, PACKAGE = ".usda", ".usdc", ".usdz"
NAMES = (".usd", TEXT, BINARY, PACKAGE)
ROOT = "/Model"
MAGICS = (b"PXR-USDC", b"#usda ")
ZIP, LENGTHS_AT, NAME_AT = b"PK\x03\x04", 26, 30  # of a file in a package: bytes from its header on
TURNS = {  # what is right, up and back in a stage, from its own axes, by what is up in it
    "Y": np.eye(4),
    "Z": np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]),
}
NAMED = 200  # characters of a line about what is not there
ARGUMENTS = ":SDF_FORMAT_ARGS:"  # what the library takes the rest of a name for
SAVED = (1980, 1, 1, 0, 0, 0, 0, 0, -1)  # local time, which a package says of its file: equal models are equal files


def require_package(path: Path) -> None:
    """Raise ``DataError`` where the library is missing."""
    try:
        import pxr  # noqa: F401
    except ImportError:
        raise DataError(path, "OpenUSD needs the package usd-core", "pip install 'mi_dogsplat[usd]'") from None


def is_usd(head: bytes) -> bool:
    """Whether a file is OpenUSD, by its first bytes."""
    length = int.from_bytes(head[26:28], "little")
    first = head[NAME_AT : NAME_AT + length].lower()
    return head.startswith(MAGICS) or head.startswith(ZIP) and first.endswith(tuple(name.encode() for name in NAMES))


@contextmanager
def opened(path: Path) -> Iterator[Usd.Stage]:
    """The stage of a file. Raises ``DataError`` for what the library cannot read, in this or while it is looked at."""
    require_package(path)
    from pxr import Usd

    with looked_at(path):
        _require_sound(path)
        with _named_by_content(path) as named:
            stage = Usd.Stage.Open(os.path.abspath(named))
            for layer in stage.GetUsedLayers():  # the library keeps those that anybody has open, as they were then
                if not layer.dirty:
                    layer.Reload()
            yield stage


@contextmanager
def looked_at(path: Path) -> Iterator[None]:
    """While the stage of a file is looked at: the library prints nothing, and what is wrong becomes ``DataError``."""
    from pxr import Tf, UsdUtils

    unheard = UsdUtils.CoalescingDiagnosticDelegate()  # what the library would print
    try:
        yield
    except DataError:
        raise
    except Tf.ErrorException as error:
        raise DataError(path, f"cannot be read as OpenUSD ({_reason(error)})", DAMAGED) from error
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror})", "check the path and its permissions") from error
    except (ValueError, TypeError, LookupError, OverflowError) as error:
        problem = f"is no OpenUSD that can be used ({error})"
        raise DataError(path, problem, "mend that, or copy or export it again") from error
    finally:
        del unheard


def _require_sound(path: Path) -> None:
    """Raise ``DataError`` where a binary file, or the first one in a package, is not what it claims to be."""
    with path.open("rb") as file:
        places = [(0, path.stat().st_size)]
        if file.read(len(ZIP)) == ZIP:
            places = _places(path, file)
        for start, size in places:
            file.seek(start)
            if file.read(len(MAGICS[0])) == MAGICS[0]:
                require_sound(path, file, start, size)


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
        raise DataError(path, f"is no package of OpenUSD ({error})", DAMAGED) from error
    return found


def _reason(error: Exception) -> str:
    """What the library says of an error first."""
    try:
        return next((part.commentary for part in error.args if hasattr(part, "commentary")), "no reason is given")
    except UnicodeDecodeError:  # it quotes the file
        return "it has text that is not UTF-8"


@contextmanager
def _named_by_content(path: Path) -> Iterator[Path]:
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


def layers_of(stage: Usd.Stage) -> list[Path]:
    """The files that a stage is made of; of what lies in a package the package."""
    from pxr import Ar

    paths = (layer.realPath for layer in stage.GetUsedLayers())
    inside = Ar.IsPackageRelativePath
    files = (Ar.SplitPackageRelativePathOuter(path)[0] if inside(path) else path for path in paths)
    return list(dict.fromkeys(Path(file) for file in files if file))


def missing(stage: Usd.Stage) -> list[str]:
    """A line about the first thing that a stage names and that cannot be found or read; none where all is there."""
    broken = stage.GetCompositionErrors()[:1]
    return [f"what cannot be found or read: {printable(' '.join(str(error).split()))[:NAMED]}" for error in broken]


def upright(stage: Usd.Stage) -> Array:
    """The matrix [4, 4] from the axes of a stage to x right, y up, z back. Raises ``ValueError``."""
    from pxr import UsdGeom

    axis = str(UsdGeom.GetStageUpAxis(stage))
    if axis not in TURNS:
        raise ValueError(f"its upAxis is {axis}, neither Y nor Z")
    return TURNS[axis]


def metres_of(stage: Usd.Stage) -> float | None:
    """Metres of a unit, where a stage says so and says more than that a unit is a metre. Raises ``ValueError``."""
    from pxr import UsdGeom

    metres = UsdGeom.GetStageMetersPerUnit(stage) if UsdGeom.StageHasAuthoredMetersPerUnit(stage) else 1.0
    if not 0 < metres < math.inf:
        raise ValueError(f"its metersPerUnit is {metres:g}, not above zero and finite")
    return None if metres == 1.0 else metres


def world_of(prim: Usd.Prim, cache: UsdGeom.XformCache) -> Array:
    """The matrix [4, 4] from the axes of a prim to those of its stage, for columns."""
    from pxr import UsdGeom

    matrix = cache.GetLocalToWorldTransform(prim)
    if not prim.IsA(UsdGeom.Xformable):  # a library that does not know the type takes what is above it alone
        matrix = UsdGeom.Xformable(prim).GetLocalTransformation(cache.GetTime()) * matrix
    return np.array(matrix).T


def new_stage() -> Usd.Stage:
    """A stage in memory with y up, in metres, and an Xform ``ROOT``, which is what a stage that references it moves."""
    from pxr import Sdf, Usd, UsdGeom

    layer = Sdf.Layer.CreateAnonymous(BINARY)
    layer.customLayerData = {"creator": "mi_dogsplat"}
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, ROOT).GetPrim()
    Usd.ModelAPI(root).SetKind("component")
    stage.SetDefaultPrim(root)
    return stage


def author(prim: Usd.Prim, name: str, kind: str, value: Array | int | str, varying: bool = True) -> Usd.Attribute:
    """Set an attribute of a prim, of a kind as text files name it; rows [N, 3] and numbers [N] become arrays."""
    from pxr import Sdf, Vt

    if isinstance(value, np.ndarray):
        arrays = {"int[]": (Vt.IntArray, np.int32), "float[]": (Vt.FloatArray, np.float32)}
        array, type_of = arrays.get(kind, (Vt.QuatfArray if kind == "quatf[]" else Vt.Vec3fArray, np.float32))
        value = array.FromNumpy(np.ascontiguousarray(value, type_of))
    variability = Sdf.VariabilityVarying if varying else Sdf.VariabilityUniform
    attribute = prim.CreateAttribute(name, Sdf.ValueTypeNames.Find(kind), custom=False, variability=variability)
    attribute.Set(value)
    return attribute


def place(prim: Usd.Prim, matrix: Array) -> None:
    """Give a prim its matrix [4, 4], for columns; none where that does nothing."""
    from pxr import Gf, UsdGeom

    if not np.array_equal(matrix, np.eye(4)):
        UsdGeom.Xformable(prim).AddTransformOp().Set(Gf.Matrix4d(matrix.T))


def write_stage(path: Path, stage: Usd.Stage) -> None:
    """Write a stage as the name of a file says: text, binary, or a package with that inside; whole or not at all.

    Raises ``DataError``.
    """
    from pxr import Tf

    suffix = next(name for name in reversed(NAMES) if path.name.lower().endswith(name))
    with writing(path):
        path.parent.stat()  # a folder that is missing is a typing error: none is made
        with replacing(path) as part, TemporaryDirectory(dir=part.parent, prefix=".usd.") as folder:
            try:
                made = _saved(stage, Path(folder), suffix)
            except Tf.ErrorException as error:  # as of a disk that is full
                raise OSError(errno.EIO, _reason(error)) from error
            shutil.move(made, part)


def _saved(stage: Usd.Stage, folder: Path, suffix: str) -> Path:
    """The file in a folder that a stage has been written to. Raises ``OSError``, and errors of the library."""
    from pxr import Sdf

    made = folder / f"model{BINARY if suffix == PACKAGE else suffix}"
    stage.GetRootLayer().Export(str(made))
    if suffix != PACKAGE:
        return made
    os.utime(made, (time.mktime(SAVED), time.mktime(SAVED)))
    package = Sdf.ZipFileWriter.CreateNew(str(made.with_suffix(PACKAGE)))
    package.AddFile(str(made), made.name)
    package.Save()
    made = made.with_suffix(PACKAGE)
    if not zipfile.is_zipfile(made):  # its end is missing: of a full disk the library says nothing here
        raise OSError(errno.EIO, "the package is not complete")
    return made
