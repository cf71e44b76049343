"""Models as PLY files: 3DGS columns in ``vertex``, and elements of what only some primitives have, ``dog`` and others.

Colours of primitives that have SH degrees of their own, in the elements ``sh1`` to ``sh3``, are filled up with zeros.
The same format as ``mi_dogsplat.scene.ply``, which documents it; this copy keeps the add-on free of other packages.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .errors import FileError
from .model import CURVATURES, CUTS, SECOND_CUTS, SHIFTS, SLOPES, Model
from .whole import write_whole

_POSITION = ("x", "y", "z")
_NORMAL = ("nx", "ny", "nz")
_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
_RGB = ("red", "green", "blue")
_C0 = 0.28209479177387814  # colour = 0.5 + C0 f_dc
_SCALE = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")  # w, x, y, z
_DOG = ("dog_opacity", "dog_scale_0", "dog_scale_1", "dog_scale_2")
_FILTER = ("filter_3D",)
_LARGEST_LOGIT = math.log(1e6 - 1)  # of an opacity of 1 - 1e-6
_SMALLEST_LOG_SCALE = math.log(1e-30)
_INSTEAD = {  # of -∞ and ∞ in some columns: opacities of 0 and 1, scales of 0
    **dict.fromkeys(("opacity", "dog_opacity"), (-_LARGEST_LOGIT, _LARGEST_LOGIT)),
    **dict.fromkeys(_SCALE, (_SMALLEST_LOG_SCALE, math.inf)),
}
_N_REST = (0, 9, 24, 45)  # by SH degree: 3 (K - 1)
_N_REST_4 = 72  # of degree 4, of which three bands are read
_CUT = ("cut_0", "cut_1", "cut_2")
_SHIFT = (*(f"shift_{i}" for i in range(9)), "view_0", "view_1", "view_2")  # axis by axis, by each of the view
_GROUPS = {"slopes": (SLOPES, tuple(f"slope_{i}" for i in range(9))),  # axis by axis, three channels each
           "curvatures": (CURVATURES, tuple(f"curvature_{i}" for i in range(6))),
           "cuts": (CUTS, _CUT), "second_cuts": (SECOND_CUTS, _CUT),
           "shifts": (SHIFTS, _SHIFT)}  # fmt: skip
_ELEMENTS = ("vertex", "dog", *_GROUPS, "sh1", "sh2", "sh3")
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_MAX_HEADER = 1 << 20  # bytes
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}
_NOT_3DGS = "give a 3D Gaussian splatting PLY with the columns x y z f_dc_* opacity scale_* rot_*"
_DAMAGED = "copy or export the file again"
_UNREADABLE, _PERMISSIONS = "cannot be read ({reason})", "check the path and its permissions"


def read_ply(path: str | Path) -> Model:
    """Read a model. Raises ``FileError`` for whatever is not one."""
    path = Path(path)
    if path.is_dir():
        raise FileError(path, "this is a folder", "give the path of a PLY file")
    try:
        with path.open("rb") as file:
            tables = _tables(path, file)
    except OSError as error:
        raise FileError(path, _UNREADABLE, _PERMISSIONS, reason=error.strerror) from error
    if "vertex" not in tables:
        raise FileError(path, 'there is no element "vertex"', _NOT_3DGS)
    vertex = tables["vertex"]
    names = vertex.dtype.names or ()
    n_rest = sum(name.startswith("f_rest_") for name in names)
    if n_rest not in (*_N_REST, _N_REST_4):
        problem = "{n} properties f_rest_*, but SH degree 0, 1, 2, 3 has 0, 9, 24, 45"
        raise FileError(path, problem, _NOT_3DGS, n=n_rest)

    means = _columns(path, tables, "vertex", _POSITION)
    rest = _rest_columns(path, tables, n_rest)
    is_dog, dog = _dog_columns(path, tables, len(means))
    log_scales, logit_opacities = _scales_and_opacities(path, tables)
    return Model(
        means=means,
        log_scales=log_scales,
        quats=_columns(path, tables, "vertex", _ROTATION),
        logit_opacities=logit_opacities,
        sh_coeffs=np.concatenate([_dc_columns(path, tables)[:, None], rest], axis=1),
        is_dog=is_dog,
        dog_logit_opacities=dog[:, 0],
        dog_log_scales=dog[:, 1:],
        **_group_columns(path, tables, len(means)),
    )


def read_comments(path: str | Path) -> list[str]:
    """The comments of a header that ``read_ply`` accepts."""
    path = Path(path)
    with path.open("rb") as file:
        return _header(path, file)[2]


def write_ply(path: str | Path, model: Model, comments: Sequence[str] = ()) -> None:
    """Write a model; ``read_ply`` gives back the same bits. The old file stays until the new one is complete.

    ``comments``: lines of the header, as ``read_comments`` finds them.

    Raises ``FileError`` when the place cannot be written or a value is not finite.
    """
    path = Path(path)
    n, n_rest = model.n_splats, _N_REST[model.sh_degree]
    names = (*_POSITION, *_NORMAL, *_DC, *_rest_names(n_rest), "opacity", *_SCALE, *_ROTATION)
    rest = model.sh_coeffs[:, 1:].transpose(0, 2, 1).reshape(n, n_rest)
    columns = [model.means, np.zeros((n, 3)), model.sh_coeffs[:, 0], rest, model.logit_opacities[:, None]]
    vertex = np.concatenate([*columns, model.log_scales, model.quats], axis=1, dtype="<f4")  # [N, len(names)]
    dog = np.concatenate([model.dog_logit_opacities[:, None], model.dog_log_scales], axis=1)
    groups = [("dog", _DOG, _rows(model.is_dog, dog))]
    for element, (group, columns_of_group) in _GROUPS.items():
        groups.append((element, columns_of_group, _rows(getattr(model, group.has), getattr(model, group.values))))
    if not all(np.isfinite(values).all() for values in (vertex, *(rows["values"] for _, _, rows in groups))):
        raise FileError(path, "the model holds values that are not finite", "delete those splats; nothing was written")

    header = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    header += [f"element vertex {n}"]
    header += [f"property float {name}" for name in names]
    for element, names, rows in groups:
        if len(rows):
            header += [f"element {element} {len(rows)}", "property uint index"]
            header += [f"property float {name}" for name in names]
    parts = vertex.tobytes(), *(rows.tobytes() for _, _, rows in groups)
    write_whole(path, ["\n".join([*header, "end_header\n"]).encode(), *parts])


def _rows(which: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The rows of those primitives [N] that have one of the values [N, ...], each with its index."""
    rows = np.empty(np.count_nonzero(which), [("index", "<u4"), ("values", "<f4", values.shape[1:])])
    rows["index"], rows["values"] = np.flatnonzero(which), values[which]
    return rows


def _rest_names(n_rest: int) -> tuple[str, ...]:
    return tuple(f"f_rest_{i}" for i in range(n_rest))


def _columns(path: Path, tables: dict[str, np.ndarray], element: str, names: tuple[str, ...]) -> np.ndarray:
    """Columns of an element by name as float32 [rows, len(names)], all of them there and finite.

    Opacities of 0 and 1 and scales of 0, logits of ±∞ and logarithms of -∞, become finite.
    """
    table = tables[element]
    out = np.empty((len(table), len(names)), np.float32)
    for i, name in enumerate(names):
        if name not in (table.dtype.names or ()):
            packed = "packed_position" in (table.dtype.names or ())
            remedy = _NOT_3DGS if element == "vertex" else _DAMAGED
            remedy = "this is a compressed PLY, export it uncompressed" if packed else remedy
            raise FileError(path, 'element "{element}" has no property "{name}"', remedy, element=element, name=name)
        with np.errstate(over="ignore", invalid="ignore"):  # doubles beyond float32 become inf: see below
            out[:, i] = table[name]
        if name in _INSTEAD:
            np.clip(out[:, i], *_INSTEAD[name], out=out[:, i], where=np.isinf(out[:, i]))
    if not np.isfinite(out).all():
        row, column = np.argwhere(~np.isfinite(out))[0]
        problem = '"{name}" in row {row} of the element "{element}" is not finite'
        raise FileError(path, problem, _DAMAGED, name=names[column], row=row, element=element)
    return out


def _scales_and_opacities(path: Path, tables: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Log scales [N, 3] and logits of opacities [N]; Mip-Splatting's column ``filter_3D`` widens its primitive."""
    scales, logits = (_columns(path, tables, "vertex", names) for names in (_SCALE, ("opacity",)))
    if _FILTER[0] not in (tables["vertex"].dtype.names or ()):
        return scales, logits[:, 0]
    widths = _columns(path, tables, "vertex", _FILTER).astype(np.float64)  # [N, 1]
    before, raw = scales.astype(np.float64), logits[:, 0].astype(np.float64)
    with np.errstate(divide="ignore"):  # log 0 = -inf is what it is meant to be
        after = np.logaddexp(2 * before, 2 * np.log(np.abs(widths))) / 2
        log_opacities = (before - after).sum(axis=1) - np.logaddexp(0, -raw)
        faded = log_opacities - np.log(-np.expm1(log_opacities))
    faded = np.clip(faded, -np.inf, max(_LARGEST_LOGIT, raw.max(initial=0)))
    return after.astype(np.float32), np.where(widths[:, 0] == 0, raw, faded).astype(np.float32)


def _dc_columns(path: Path, tables: dict[str, np.ndarray]) -> np.ndarray:
    """f_dc_* [N, 3], or what red, green and blue stand for where a file has these in their place: integers of 8 or 16
    bits, or floats in 0..1 or 0..255."""
    dtype = tables["vertex"].dtype
    names = dtype.names or ()
    if _DC[0] in names or not set(_RGB) <= set(names):
        return _columns(path, tables, "vertex", _DC)
    colors = _columns(path, tables, "vertex", _RGB)
    brightest = colors.max(initial=0)
    full = 65535 if brightest > 255 else 255 if brightest > 1 or dtype[_RGB[0]].kind != "f" else 1
    return ((colors / full - 0.5) / _C0).astype(np.float32)


def _dog_columns(path: Path, tables: dict[str, np.ndarray], n: int) -> tuple[np.ndarray, np.ndarray]:
    """(is_dog [N], the columns of ``_DOG`` [N, 4]) from the element ``dog``, or from the authors' layout."""
    inside_vertex = any(name in _DOG for name in tables["vertex"].dtype.names or ())
    if "dog" not in tables:
        if inside_vertex:
            return np.ones(n, bool), _columns(path, tables, "vertex", _DOG)
        return np.zeros(n, bool), np.zeros((n, 4), np.float32)
    if inside_vertex:
        problem = 'DoG data both in the element "vertex" and in the element "dog"'
        raise FileError(path, problem, "keep one of the two")
    index = _index(path, tables, "dog", n)
    is_dog, dog = np.zeros(n, bool), np.zeros((n, 4), np.float32)
    is_dog[index] = True
    dog[index] = _columns(path, tables, "dog", _DOG)
    return is_dog, dog


def _group_columns(path: Path, tables: dict[str, np.ndarray], n: int) -> dict[str, np.ndarray]:
    """The arrays of each group of ``_GROUPS``, by their names in a ``Model``."""
    found: dict[str, np.ndarray] = {}
    for element, (group, names) in _GROUPS.items():
        if element in tables:
            index = _index(path, tables, element, n)
            found |= group.of_some(n, index, _columns(path, tables, element, names))
        else:
            found |= group.of_none(n)
    return found


def _rest_columns(path: Path, tables: dict[str, np.ndarray], n_rest: int) -> np.ndarray:
    """SH coefficients [N, K - 1, 3] above the constant one, from ``vertex`` or from the elements for each degree."""
    vertex, degrees = tables["vertex"], [degree for degree in (1, 2, 3) if f"sh{degree}" in tables]
    if not degrees:
        columns = _columns(path, tables, "vertex", _rest_names(n_rest))
        by_coefficient = columns.reshape(len(vertex), 3, n_rest // 3).transpose(0, 2, 1)  # channel-major in the file
        return by_coefficient[:, : _N_REST[-1] // 3]
    if n_rest:
        problem = 'view-dependent color both in the element "vertex" and in the element "{name}"'
        raise FileError(path, problem, "keep f_rest_* in one of the two", name=f"sh{degrees[0]}")
    rest, filled = np.zeros((len(vertex), _N_REST[degrees[-1]] // 3, 3), np.float32), np.zeros(len(vertex), bool)
    for degree in degrees:
        element, k = f"sh{degree}", _N_REST[degree] // 3
        columns, index = _columns(path, tables, element, _rest_names(3 * k)), _index(path, tables, element, len(vertex))
        if (twice := index[filled[index]]).size:
            problem = "more than one of the elements sh1, sh2, sh3 names primitive {number}"
            raise FileError(path, problem, _DAMAGED, number=twice[0])
        rest[index, :k], filled[index] = columns.reshape(-1, 3, k).transpose(0, 2, 1), True
    return rest


def _index(path: Path, tables: dict[str, np.ndarray], element: str, n: int) -> np.ndarray:
    """The column ``index`` [M]: different primitives."""
    _columns(path, tables, element, ("index",))
    index = tables[element]["index"].astype(np.float64)  # any 32-bit integer is exact
    whole = (index >= 0) & (index < n) & (index == np.floor(index))
    if not whole.all() or len(np.unique(index)) != len(index):
        problem = 'the element "{name}" does not name different primitives of 0 to {last}'
        raise FileError(path, problem, _DAMAGED, name=element, last=n - 1)
    return index.astype(np.int64)


def _tables(path: Path, file: BinaryIO) -> dict[str, np.ndarray]:
    """Those of ``_ELEMENTS`` that there are as structured arrays.

    Elements after the last of them are read only where none has a list. Then the file has to end with them, as a
    damaged count would go unnoticed.
    """
    byte_order, elements, _ = _header(path, file)
    all_fixed = not any("list" in properties.values() for _, _, properties in elements)
    last = max((i for i, (name, _, _) in enumerate(elements) if all_fixed or name in _ELEMENTS), default=-1)
    words, size = file.read().split() if byte_order == "=" else [], os.fstat(file.fileno()).st_size
    tables, at = {}, 0
    for name, count, properties in elements[: last + 1]:
        if "list" in properties.values():
            raise FileError(path, 'element "{name}" has a list property', _NOT_3DGS, name=name)
        if byte_order == "=":
            dtype = np.dtype([(key, "f8") for key in properties])
            n_values = count * len(properties)
            try:
                data = np.array(words[at : at + n_values], np.float64).tobytes()
            except ValueError:
                problem = 'element "{name}" holds something that is not a number'
                raise FileError(path, problem, _DAMAGED, name=name) from None
            at += n_values
        else:
            dtype = np.dtype([(key, byte_order + code) for key, code in properties.items()])
            data = file.read(min(count * dtype.itemsize, size))  # no memory for what is not there
        if len(data) != count * dtype.itemsize:
            raise FileError(path, 'the file ends inside of element "{name}"', _DAMAGED, name=name)
        tables[name] = np.frombuffer(data, dtype) if data else np.zeros(0, dtype)
    if all_fixed and (file.read(1) or words[at:]):
        raise FileError(path, "data is left over after the last element", _DAMAGED)
    return {name: table for name, table in tables.items() if name in _ELEMENTS}


def _header(path: Path, file: BinaryIO) -> tuple[str, list[tuple[str, int, dict[str, str]]], list[str]]:
    """(byte order, elements as (name, count, properties), comments); leaves the file at the first byte of data."""
    if file.readline(8).rstrip() != b"ply":
        raise FileError(path, 'not a PLY file (its first line is not "ply")', _NOT_3DGS)
    byte_order, elements, comments = "", [], []
    while True:
        line = file.readline(_MAX_HEADER)
        words = line.decode("ascii", "replace").split()
        if not line.endswith(b"\n") or file.tell() > _MAX_HEADER:
            raise FileError(path, 'the header has no "end_header" line', _DAMAGED)
        match words:
            case ["comment", *rest]:
                comments.append(" ".join(rest))
            case [] | ["obj_info", *_]:
                continue
            case ["end_header"]:
                break
            case ["format", name, "1.0"] if name in _BYTE_ORDERS:
                byte_order = _BYTE_ORDERS[name]
            case ["element", name, _] if any(name == other for other, _, _ in elements):
                raise FileError(path, 'element "{name}" is declared twice', _DAMAGED, name=name)
            case ["property", *_, name] if elements and name in elements[-1][2]:  # rows would be taken for shorter ones
                raise FileError(path, 'property "{name}" is declared twice', _DAMAGED, name=name)
            case ["element", name, count] if count.isdecimal() and len(count) <= 18:
                elements.append((name, int(count), {}))
            case ["property", "list", _, _, name] if elements:
                elements[-1][2][name] = "list"
            case ["property", code, name] if elements and code in _TYPES:
                elements[-1][2][name] = _TYPES[code]
            case _:
                raise FileError(path, 'header line "{line}" makes no sense', _DAMAGED, line=" ".join(words)[:60])
    if not byte_order:
        raise FileError(path, 'the header has no "format" line', _DAMAGED)
    return byte_order, elements, comments
