"""Models as PLY files: 3DGS columns in the element ``vertex``, what only some primitives have in elements after it.

Layout written: binary little-endian; ``vertex`` in INRIA's column order (x y z nx ny nz f_dc_* f_rest_*
opacity scale_* rot_*), so that other 3DGS tools and Mitsuba's ``ellipsoids`` open it; then ``dog`` (uint
index, float dog_opacity, float dog_scale_0..2), one row per DoG primitive, absent in a model without DoG; then
``slopes`` (uint index, float slope_0..8: by axis, then channel), one row per primitive whose colour varies over it;
then ``curvatures`` (uint index, float curvature_0..5), one row per primitive whose brightness curves over it;
then ``cuts`` (uint index, float cut_0..2), one row per primitive that a plane cuts off, and ``second_cuts``, alike, one
per primitive that a second one cuts off; then ``shifts`` (uint index, float shift_0..8: by axis of the move, then of
the view, float view_0..2), one row per primitive whose place depends on the view. All values are raw.

A model whose primitives have SH degrees of their own is padded with zeros to the highest one, or, in the layout
"rows", written with f_dc_* alone in ``vertex``, and at the end an element ``sh1``, ``sh2``, ``sh3`` for each degree
that there is (uint index, float f_rest_*, channel-major as in ``vertex``), one row per primitive of that degree.

Read as well: ASCII, big-endian, any scalar types, columns in any order, extra columns and elements, files without
normals (gsplat), SH degree 0..4 (of 4 without what is above 3), opacities of 0 and 1 and scales of 0 (logits of ±∞ and
logarithms of -∞, which become finite), the method authors' layout (dog_* as columns of ``vertex``: all are DoG),
colours as red, green and blue in place of f_dc_* (nerfstudio without view-dependent colour), and Mip-Splatting's column
filter_3D, which widens its primitive (``filter_3d.py``).
"""

from __future__ import annotations

import math
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from ..support.arguments import checks_arguments
from ..support.errors import DataError
from ..support.files import write_bytes
from ..support.wording import counted
from .filter_3d import filtered
from .opacity import LARGEST_LOGIT
from .ply_tables import N_REST, NOT_3DGS, RGB, TableReader, check_finite, in_unit, rest_names
from .quaternions import WXYZ_FROM_XYZW, XYZW_FROM_WXYZ
from .row_groups import CURVATURES, CUTS, SECOND_CUTS, SH, SHIFTS, SLOPES, Array, RowGroup, in_several
from .scales import SMALLEST_LOG_SCALE
from .sh_basis import C0
from .splats import Splats

_POSITION = ("x", "y", "z")
_NORMAL = ("nx", "ny", "nz")
_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALE = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")  # w, x, y, z
_DOG = ("dog_opacity", "dog_scale_0", "dog_scale_1", "dog_scale_2")
_FILTER = ("filter_3D",)
_NOT_WRITTEN = "nothing was written; remove those primitives or train with smaller steps"
_SH_ELEMENTS = {degree: f"sh{degree}" for degree in SH}
_OF_SOME = {
    "slopes": (SLOPES, ("slope",)),
    "curvatures": (CURVATURES, ("curvature",)),
    "cuts": (CUTS, ("cut",)),
    "second_cuts": (SECOND_CUTS, ("cut",)),
    "shifts": (SHIFTS, ("shift", "view")),
}
"""By element: its group, and how the columns of each of its arrays begin."""


@checks_arguments
def read_ply(path: str | Path) -> Splats:
    """Read the primitives of a 3DGS PLY, in its axes. Raises ``DataError`` for whatever is not one; memory stays in
    proportion to the file."""
    return read_ply_and_comments(path)[0]


def read_ply_and_comments(path: str | Path, finite: bool = True) -> tuple[Splats, list[str], list[str]]:
    """Read a model, the comments of its header, and what of it is left out, in words. Raises as ``read_ply`` does.

    ``finite``: its numbers have to be; else they are left as they are.
    """
    path = Path(path)
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):  # opening a pipe would wait for ever
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "not a regular file"
            raise DataError(path, f"this is {kind}", "give the path of a PLY file")
        with path.open("rb") as file:
            reader = TableReader(path, file, status.st_size, finite)
            return _read_model(reader), reader.comments, reader.left_out
    except OSError as e:
        raise DataError(path, f"cannot be read ({e.strerror})", "check the path and its permissions") from e


def _read_model(reader: TableReader) -> Splats:
    tables = reader.tables({"vertex", "dog", *_OF_SOME, *_SH_ELEMENTS.values()})
    if "vertex" not in tables:
        reader.fail('there is no element "vertex"', NOT_3DGS)
    vertex = tables["vertex"]
    flat_rest = reader.rest_columns(vertex, "vertex", NOT_3DGS)  # [N, 3 (K - 1)]
    means = reader.columns(vertex, "vertex", _POSITION)  # [N, 3]
    dc = _read_dc(reader, vertex)  # [N, 3]
    rest = _by_coefficient(flat_rest)  # [N, K-1, 3]
    logit_opacities = reader.columns(vertex, "vertex", ("opacity",), -LARGEST_LOGIT, LARGEST_LOGIT)[:, 0]  # [N]
    log_scales = reader.columns(vertex, "vertex", _SCALE, SMALLEST_LOG_SCALE)  # [N, 3]
    if _FILTER[0] in (vertex.dtype.names or ()):
        widths = reader.columns(vertex, "vertex", _FILTER)[:, 0]  # [N]
        log_scales, logit_opacities = filtered(log_scales, logit_opacities, widths)
    quats = reader.columns(vertex, "vertex", _ROTATION)[:, XYZW_FROM_WXYZ]  # [N, 4]
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
        **_read_of_some(reader, tables, len(means)),
        **_read_sh_groups(reader, tables, len(means), flat_rest.shape[1]),
    )


def _read_dc(reader: TableReader, vertex: Array) -> Array:
    """Columns f_dc_* [N, 3], or those that red, green and blue stand for where a file has these in their place."""
    names = vertex.dtype.names or ()
    if _DC[0] in names or not set(RGB) <= set(names):
        return reader.columns(vertex, "vertex", _DC)
    return (in_unit(reader.columns(vertex, "vertex", RGB), reader.codes["vertex"][RGB[0]]) - 0.5) / C0


def _read_dog(reader: TableReader, tables: dict[str, Array], n_splats: int) -> tuple[Array, Array]:
    """dog_index [M], sorted, and the columns of ``_DOG`` [M, 4], from whichever layout is there."""
    inside_vertex = any(name in _DOG for name in tables["vertex"].dtype.names or ())
    if "dog" not in tables:
        if not inside_vertex:
            return np.zeros(0, np.uint32), np.zeros((0, 4), np.float32)
        return np.arange(n_splats), _dog_columns(reader, tables["vertex"], "vertex")

    if inside_vertex:
        reader.fail('DoG data both in the element "vertex" and in the element "dog"', "keep one of the two")
    index, order = _read_index(reader, tables["dog"], "dog", n_splats, "DoG primitive")
    return index, _dog_columns(reader, tables["dog"], "dog")[order]


def _dog_columns(reader: TableReader, table: Array, element: str) -> Array:
    opacity = reader.columns(table, element, _DOG[:1], -LARGEST_LOGIT, LARGEST_LOGIT)
    return np.concatenate([opacity, reader.columns(table, element, _DOG[1:])], axis=1)


def _read_of_some(reader: TableReader, tables: dict[str, Array], n_splats: int) -> dict[str, Array]:
    """The arrays of slopes and so on, of those that are there."""
    found: dict[str, Array] = {}
    for element, (group, columns) in _OF_SOME.items():
        if element in tables:
            row = f"primitive with {element.replace('_', ' ')}"
            index, order = _read_index(reader, tables[element], element, n_splats, row)
            found[group.index] = index
            for column, (name, shape) in zip(columns, group.arrays.items(), strict=True):
                values = reader.columns(tables[element], element, _numbered(column, shape))[order]
                found[name] = values.reshape(-1, *shape)
    return found


def _read_sh_groups(reader: TableReader, tables: dict[str, Array], n_splats: int, n_rest: int) -> dict[str, Array]:
    """The arrays of the groups of SH degrees that are there."""
    groups: dict[str, Array] = {}
    for degree, element in _SH_ELEMENTS.items():
        if element not in tables:
            continue
        if n_rest:
            remedy = "keep f_rest_* in one of the two"
            reader.fail(f'view-dependent colour both in the element "vertex" and in the element "{element}"', remedy)
        index, order = _read_index(reader, tables[element], element, n_splats, f"primitive of degree {degree}")
        rest = reader.columns(tables[element], element, rest_names(N_REST[degree]))
        (name,) = SH[degree].names
        groups |= {SH[degree].index: index, name: _by_coefficient(rest)[order]}
    indices = [values for name, values in groups.items() if name.endswith("_index")]
    if indices and (twice := in_several(indices)) is not None:
        remedy = "write the model again: a primitive has one degree"
        reader.fail(f"more than one of the elements sh1, sh2, sh3 names primitive {twice}", remedy)
    return groups


def _read_index(reader: TableReader, table: Array, element: str, n_splats: int, row: str) -> tuple[Array, Array]:
    """(the column ``index`` [M] of an element, sorted, the rows in that order); ``row`` is what a row stands for."""
    reader.columns(table, element, ("index",))  # it is there and finite; float32 would round it
    index = table["index"].astype(np.float64)  # [M] any 32-bit integer is exact
    data = "DoG" if element == "dog" else element.rstrip("s").replace("_", " ") if element in _OF_SOME else "SH"
    remedy = f"write the {data} data again, one row per {row}"
    bad = np.flatnonzero((index < 0) | (index >= n_splats) | (index != np.floor(index)))
    if bad.size:
        where = f'row {bad[0]} of the element "{element}" has index {index[bad[0]]:.10g}'
        reader.fail(f"{where}, but the model has {counted(n_splats, 'primitive')} (0 to {n_splats - 1})", remedy)
    order = np.argsort(index, kind="stable")
    index = index[order].astype(np.uint32)
    repeated = np.flatnonzero(index[1:] == index[:-1])
    if repeated.size:
        reader.fail(f'the element "{element}" names primitive {index[repeated[0]]} more than once', remedy)
    return index, order


LAYOUTS = "3dgs", "rows"


@checks_arguments
def write_ply(
    path: str | Path, splats: Splats, layout: Literal["3dgs", "rows"] = "3dgs", comments: Sequence[str] = ()
) -> None:
    """Write a model; ``read_ply`` gives back the same bits. The old file stays until the new one is complete.

    Args:
        layout: how a model is written whose primitives have SH degrees of their own. "3dgs": every primitive gets the
            coefficients of the highest one, which every program reads; the degrees are not in the file. "rows": no
            primitive has more than its own; programs that do not know the further elements show the model without its
            view-dependent colour. A uniform model is the same file in both.
        comments: lines for the header, such as ``drawing.comments_of`` makes.

    Raises ``DataError`` when the place cannot be written, or a value is not finite (nobody could read it), and
    ``ValueError`` for primitives that are no ``Splats`` and a layout of another name.
    """
    if not isinstance(splats, Splats):
        raise ValueError(f"write_ply: primitives are Splats, not {type(splats).__name__}; write_model writes a Model")
    if layout not in LAYOUTS:
        raise ValueError(f'write_ply: layout "{layout}" is unknown; use {" or ".join(LAYOUTS)}')
    path = Path(path)
    if layout == "3dgs" and splats.mixed_sh:
        splats = splats.uniform_sh()
    n = splats.n_splats
    rest = _by_channel(splats.sh_coeffs[:, 1:])
    names = (*_POSITION, *_NORMAL, *_DC, *rest_names(rest.shape[1]), "opacity", *_SCALE, *_ROTATION)
    columns = [
        splats.means,
        np.zeros((n, 3)),
        splats.sh_coeffs[:, 0],
        rest,
        splats.logit_opacities[:, None],
        splats.log_scales,
        splats.quats[:, WXYZ_FROM_XYZW],
    ]
    vertex = np.concatenate(columns, axis=1, dtype="<f4")  # [N, len(names)]
    check_finite(path, "vertex", names, vertex, _NOT_WRITTEN)
    header = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    header += [f"element vertex {n}"]
    header += [f"property float {name}" for name in names]
    data = [vertex.tobytes()]

    for element, names, index, values in _groups_of(splats):
        if len(index):
            check_finite(path, element, names, values, _NOT_WRITTEN)
            header += [f"element {element} {len(index)}", "property uint index"]
            header += [f"property float {name}" for name in names]
            data.append(_rows(index, values))
    write_bytes(path, "\n".join([*header, "end_header\n"]).encode(), *data)


def _groups_of(splats: Splats) -> Iterator[tuple[str, tuple[str, ...], Array, Array]]:
    """(element, names of its columns, index [M], values [M, columns]) of each group, in the order of the file."""
    dog = np.concatenate([splats.dog_logit_opacities[:, None], splats.dog_log_scales], axis=1)  # [M, 4]
    yield "dog", _DOG, splats.dog_index, dog
    for element, (group, columns) in _OF_SOME.items():
        names, values = _columns_of(splats, group, columns)
        yield element, names, getattr(splats, group.index), values
    for degree, element in _SH_ELEMENTS.items():
        (name,) = SH[degree].names
        rest = _by_channel(getattr(splats, name))
        yield element, rest_names(N_REST[degree]), getattr(splats, SH[degree].index), rest


def rows_save(degrees: Array) -> int:
    """Bytes that the layout "rows" saves where primitives have these SH degrees [N]; negative where it takes more.

    There each primitive above degree 0 has an index, and each degree an element. Of equal degrees it is the same file.
    """
    if len(np.unique(degrees)) < 2:
        return 0
    counts = {degree: np.count_nonzero(degrees == degree) for degree in SH}
    highest = max((degree for degree, n in counts.items() if n), default=0)
    padded = _header_of_rest(highest) + 4 * N_REST[highest] * len(degrees)
    rows = sum(
        len(f"element {_SH_ELEMENTS[degree]} {n}\nproperty uint index\n") + _header_of_rest(degree)
        + 4 * (1 + N_REST[degree]) * n
        for degree, n in counts.items() if n
    )  # fmt: skip
    return padded - rows


def _header_of_rest(degree: int) -> int:
    """Bytes of the lines for f_rest_*."""
    return sum(len(f"property float {name}\n") for name in rest_names(N_REST[degree]))


def _rows(index: Array, values: Array) -> bytes:
    """The rows of a group: an index [M] with values [M, columns]."""
    rows = np.empty(len(index), [("index", "<u4"), ("values", "<f4", values.shape[1])])
    rows["index"], rows["values"] = index, values
    return rows.tobytes()


def _by_coefficient(rest: Array) -> Array:
    """Columns f_rest_* [n, 3 (K-1)], channel-major, as SH coefficients [n, K-1, 3]."""
    return rest.reshape(len(rest), 3, rest.shape[1] // 3).transpose(0, 2, 1)


def _by_channel(coeffs: Array) -> Array:
    """SH coefficients [n, K-1, 3] as columns f_rest_* [n, 3 (K-1)]."""
    return coeffs.transpose(0, 2, 1).reshape(len(coeffs), 3 * coeffs.shape[1])


def _columns_of(splats: Splats, group: RowGroup, columns: tuple[str, ...]) -> tuple[tuple[str, ...], Array]:
    """(names of the columns of a group, its values [M, columns])."""
    names, values = [], []
    for column, (name, shape) in zip(columns, group.arrays.items(), strict=True):
        names += _numbered(column, shape)
        values.append(getattr(splats, name).reshape(-1, math.prod(shape)))
    return tuple(names), np.concatenate(values, axis=1)


def _numbered(column: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Names of the columns that hold a row of this shape, the last axis fastest."""
    return tuple(f"{column}_{i}" for i in range(math.prod(shape)))
