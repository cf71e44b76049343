"""Making a stage of OpenUSD, and writing it whole or not at all."""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

from __future__ import annotations

import errno
import os
import shutil
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from ..scene.splats import Array
from ..support.errors import writing
from ..support.files import replacing
from .usd_files import BINARY, NAMES, PACKAGE, reason

if TYPE_CHECKING:
    from pxr import Usd

ROOT = "/Model"
SAVED = (1980, 1, 1, 0, 0, 0, 0, 0, -1)  # local time, which a package says of its file: equal models are equal files


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
        arrays = {"int[]": Vt.IntArray, "float[]": Vt.FloatArray, "quatf[]": Vt.QuatfArray}
        rows = np.ascontiguousarray(value, np.int32 if kind == "int[]" else np.float32)
        value = arrays.get(kind, Vt.Vec3fArray).FromNumpy(rows)
    variability = Sdf.VariabilityVarying if varying else Sdf.VariabilityUniform
    attribute = prim.CreateAttribute(name, Sdf.ValueTypeNames.Find(kind), custom=False, variability=variability)
    attribute.Set(value)
    return attribute


def place(prim: Usd.Prim, matrix: Array) -> None:
    """Give a prim its matrix [4, 4], for columns; none where that does nothing."""
    from pxr import Gf, UsdGeom

    if not np.array_equal(matrix, np.eye(4)):
        UsdGeom.Xformable(prim).AddTransformOp().Set(Gf.Matrix4d(matrix.T))


def write_stage(path: Path, stage: Usd.Stage, packed: Mapping[str, bytes] = MappingProxyType({})) -> None:
    """Write a stage as the name of a file says: text, binary, or a package with that inside; whole or not at all.

    ``packed``: files that lie beside the stage in a package, by their names. Raises ``DataError``.
    """
    from pxr import Tf

    suffix = next(name for name in reversed(NAMES) if path.name.lower().endswith(name))
    with writing(path):
        path.parent.stat()  # a folder that is missing is a typing error: none is made
        with replacing(path) as part, TemporaryDirectory(dir=part.parent, prefix=".usd.") as folder:
            try:
                made = _saved(stage, Path(folder), suffix, packed)
            except Tf.ErrorException as error:  # as of a disk that is full
                raise OSError(errno.EIO, reason(error)) from error
            shutil.move(made, part)


def _saved(stage: Usd.Stage, folder: Path, suffix: str, packed: Mapping[str, bytes]) -> Path:
    """The file in a folder that a stage has been written to. Raises ``OSError``, and errors of the library."""
    from pxr import Sdf

    made = folder / f"model{BINARY if suffix == PACKAGE else suffix}"
    stage.GetRootLayer().Export(str(made))
    if suffix != PACKAGE:
        return made
    package = Sdf.ZipFileWriter.CreateNew(str(made.with_suffix(PACKAGE)))
    others = [folder / f"beside_{k}" for k in range(len(packed))]
    for file, content in zip(others, packed.values(), strict=True):
        file.write_bytes(content)
    for file, name in zip((made, *others), (made.name, *packed), strict=True):
        os.utime(file, (time.mktime(SAVED), time.mktime(SAVED)))
        package.AddFile(str(file), name)
    package.Save()
    made = made.with_suffix(PACKAGE)
    if not zipfile.is_zipfile(made):  # its end is missing: of a full disk the library says nothing here
        raise OSError(errno.EIO, "the package is not complete")
    return made
