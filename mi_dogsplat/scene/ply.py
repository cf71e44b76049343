"""Models as PLY files: 3DGS columns in the element ``vertex``, DoG data in a second element ``dog``.

Layout written: binary little-endian; ``vertex`` in INRIA's column order (x y z nx ny nz f_dc_* f_rest_*
opacity scale_* rot_*), so that other 3DGS tools and Mitsuba's ``ellipsoids`` open it; then ``dog`` (uint
index, float dog_opacity, float dog_scale_0..2), one row per DoG primitive, absent in a model without DoG. All
values are raw. Read as well: ASCII, big-endian, any scalar types, columns in any order, extra columns and
elements, files without normals (gsplat), SH degree 0..3, and the method authors' layout (dog_* as columns of
``vertex``: all are DoG).
"""

from __future__ import annotations

import stat
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..support.errors import DataError
from ..support.files import replacing
from .ply_tables import NOT_3DGS, TableReader, check_finite
from .splats import Array, Splats

_POSITION = ("x", "y", "z")
_NORMAL = ("nx", "ny", "nz")
_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALE = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")  # w, x, y, z
_XYZW_FROM_WXYZ = [1, 2, 3, 0]
_WXYZ_FROM_XYZW = [3, 0, 1, 2]
_DOG = ("dog_opacity", "dog_scale_0", "dog_scale_1", "dog_scale_2")
_N_REST = (0, 9, 24, 45)  # by SH degree: 3 (K - 1)


def read_ply(path: str | Path) -> Splats:
    """Read a model. Raises ``DataError`` for whatever is not one; memory stays in proportion to the file."""
    return read_ply_and_comments(path)[0]


def read_ply_and_comments(path: str | Path) -> tuple[Splats, list[str]]:
    """Read a model, and the comments of its header. Raises as ``read_ply`` does."""
    path = Path(path)
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):  # opening a pipe would wait for ever
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "not a regular file"
            raise DataError(path, f"this is {kind}", "give the path of a PLY file")
        with path.open("rb") as file:
            reader = TableReader(path, file, status.st_size)
            return _read_model(reader), reader.comments
    except OSError as e:
        raise DataError(path, f"cannot be read ({e.strerror})", "check the path and its permissions") from e


def _read_model(reader: TableReader) -> Splats:
    tables = reader.tables({"vertex", "dog"})
    if "vertex" not in tables:
        reader.fail('there is no element "vertex"', NOT_3DGS)
    vertex = tables["vertex"]
    n_rest = sum(name.startswith("f_rest_") for name in vertex.dtype.names or ())
    if n_rest not in _N_REST:
        reader.fail(f"{n_rest} properties f_rest_*, but SH degree 0, 1, 2, 3 has 0, 9, 24, 45", NOT_3DGS)

    means = reader.columns(vertex, "vertex", _POSITION)  # [N, 3]
    dc = reader.columns(vertex, "vertex", _DC)  # [N, 3]
    rest = reader.columns(vertex, "vertex", _rest_names(n_rest))  # [N, 3 (K-1)] channel-major
    rest = rest.reshape(len(rest), 3, n_rest // 3).transpose(0, 2, 1)  # [N, K-1, 3]
    logit_opacities = reader.columns(vertex, "vertex", ("opacity",))[:, 0]  # [N]
    log_scales = reader.columns(vertex, "vertex", _SCALE)  # [N, 3]
    quats = reader.columns(vertex, "vertex", _ROTATION)[:, _XYZW_FROM_WXYZ]  # [N, 4]
    dog_index, dog = _read_dog(reader, tables, len(means))  # [M], [M, 4]
    return Splats(
        means=means,
        log_scales=log_scales,
        quats=quats,
        logit_opacities=logit_opacities,
        sh_coeffs=np.concatenate([dc[:, None], rest], axis=1),
        dog_index=dog_index,
        dog_logit_opacities=dog[:, 0],
        dog_log_scales=dog[:, 1:],
    )


def _read_dog(reader: TableReader, tables: dict[str, Array], n_splats: int) -> tuple[Array, Array]:
    """dog_index [M], sorted, and the columns of ``_DOG`` [M, 4], from whichever layout is there."""
    inside_vertex = any(name in _DOG for name in tables["vertex"].dtype.names or ())
    if "dog" not in tables:
        if not inside_vertex:
            return np.zeros(0, np.uint32), np.zeros((0, 4), np.float32)
        return np.arange(n_splats), reader.columns(tables["vertex"], "vertex", _DOG)

    if inside_vertex:
        reader.fail('DoG data both in the element "vertex" and in the element "dog"', "keep one of the two")
    table = tables["dog"]
    reader.columns(table, "dog", ("index",))  # it is there and finite; float32 would round it
    index = table["index"].astype(np.float64)  # [M] any 32-bit integer is exact
    remedy = "write the DoG data again, one row per DoG primitive"
    bad = np.flatnonzero((index < 0) | (index >= n_splats) | (index != np.floor(index)))
    if bad.size:
        where = f'row {bad[0]} of the element "dog" has index {index[bad[0]]:.10g}'
        reader.fail(f"{where}, but the model has {n_splats} primitives (0 to {n_splats - 1})", remedy)
    order = np.argsort(index, kind="stable")
    index = index[order].astype(np.uint32)
    repeated = np.flatnonzero(index[1:] == index[:-1])
    if repeated.size:
        reader.fail(f'the element "dog" names primitive {index[repeated[0]]} more than once', remedy)
    return index, reader.columns(table, "dog", _DOG)[order]


def write_ply(path: str | Path, splats: Splats, comments: Sequence[str] = ()) -> None:
    """Write a model; ``read_ply`` gives back the same bits. The old file stays until the new one is complete.

    ``comments``: lines for the header, such as ``drawing.comments_of`` makes.

    Raises ``DataError`` when the place cannot be written, or a value is not finite (nobody could read it).
    """
    path = Path(path)
    n = splats.n_splats
    n_rest = _N_REST[splats.sh_degree]
    names = (*_POSITION, *_NORMAL, *_DC, *_rest_names(n_rest), "opacity", *_SCALE, *_ROTATION)
    columns = [
        splats.means,
        np.zeros((n, 3)),
        splats.sh_coeffs[:, 0],
        splats.sh_coeffs[:, 1:].transpose(0, 2, 1).reshape(n, n_rest),  # channel-major
        splats.logit_opacities[:, None],
        splats.log_scales,
        splats.quats[:, _WXYZ_FROM_XYZW],
    ]
    vertex = np.concatenate(columns, axis=1, dtype="<f4")  # [N, len(names)]
    dog = np.concatenate([splats.dog_logit_opacities[:, None], splats.dog_log_scales], axis=1)  # [M, 4]
    remedy = "nothing was written; remove those primitives or train with smaller steps"
    check_finite(path, names, vertex, remedy)
    check_finite(path, _DOG, dog, remedy)

    header = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    header += [f"element vertex {n}"]
    header += [f"property float {name}" for name in names]
    if splats.n_dog:
        header += [f"element dog {splats.n_dog}", "property uint index"]
        header += [f"property float {name}" for name in _DOG]
    dog_rows = np.empty(splats.n_dog, [("index", "<u4"), ("values", "<f4", 4)])  # [M]
    dog_rows["index"] = splats.dog_index
    dog_rows["values"] = dog
    _replace(path, "\n".join([*header, "end_header\n"]).encode(), vertex.tobytes(), dog_rows.tobytes())


def _rest_names(n_rest: int) -> tuple[str, ...]:
    return tuple(f"f_rest_{i}" for i in range(n_rest))


def _replace(path: Path, *parts: bytes):
    """Make ``parts`` the content of ``path``, or leave everything as it was."""
    try:
        path.parent.stat()  # a folder that is missing is a typing error: none is made
        with replacing(path) as part, part.open("xb") as file:
            file.writelines(parts)
    except OSError as e:
        remedy = "check that the folder exists, is writable and has space"
        raise DataError(path, f"cannot be written ({e.strerror})", remedy) from e
