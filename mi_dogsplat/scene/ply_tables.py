"""The PLY container: named elements with named columns, read as NumPy tables. It knows nothing about splats.

ASCII, both binary byte orders and all scalar types. Sizes are compared with the file before anything is
allocated, and every complaint is one ``DataError`` line.

Own parser instead of the library plyfile: that one is under the GPL, which would bind every user of this
package, and what matters here (those size checks, one-line errors, atomic writing) it leaves to us anyway.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import BinaryIO, NoReturn

import numpy as np

from ..support.errors import DataError
from ..support.wording import counted
from .row_groups import Array
from .sh_basis import SH_LEFT_OUT

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}
_MAX_HEADER_BYTES = 1 << 20  # real headers have 1-2 kB
RGB = ("red", "green", "blue")
N_REST = (0, 9, 24, 45)  # properties f_rest_* by SH degree: 3 (K - 1)
N_REST_4 = 72  # of degree 4, of which models hold the first three bands
MAX_COLOR = 65535  # of the widest integers that colours are written in
_NAMED = 4  # elements in the words about a file that is too short, so that they stay a line

NOT_3DGS = "give a 3D Gaussian splatting PLY with the columns x y z f_dc_* opacity scale_* rot_*"
NOT_FINITE = "remove those primitives with dogsplat clean, or export the model again"
_DAMAGED = "the file is damaged or incomplete: copy or export it again"


@dataclass
class _Element:
    """One ``element`` of a header: its row count and its columns (name -> NumPy type code)."""

    name: str
    count: int
    properties: dict[str, str] = field(default_factory=dict)
    has_list: bool = False

    def dtype(self, byte_order: str) -> np.dtype:
        return np.dtype([(name, byte_order + code) for name, code in self.properties.items()])

    def least_bytes(self, file_format: str) -> int:
        """Bytes of data; in ASCII the least possible: a digit and a separator per value."""
        if file_format == "ascii":
            return self.count * len(self.properties) * 2
        return self.count * self.dtype("<").itemsize


class TableReader:
    """Reads the elements of one open file of ``size`` bytes; ``path`` is for its error messages.

    ``finite``: columns have to be.
    """

    def __init__(self, path: Path, file: BinaryIO, size: int, finite: bool = True):
        self.path, self.file, self.size, self.finite = path, file, size, finite
        self.comments: list[str] = []  # of the header, once it is read
        self.left_out: list[str] = []  # what columns have that models do not hold
        self.codes: dict[str, dict[str, str]] = {}  # NumPy's, of each element's columns, as the header has them

    def fail(self, problem: str, remedy: str = _DAMAGED) -> NoReturn:
        raise DataError(self.path, problem, remedy)

    def tables(self, wanted: set[str], trailer: bool = False) -> dict[str, Array]:
        """Those elements of ``wanted`` that exist, as structured arrays [count].

        Data after the last wanted element is not read, but when every element has a fixed size the file must
        end where the last one does: a damaged count would otherwise go unnoticed. With ``trailer`` something may
        follow in a binary file, for ``trailer()``.
        """
        file_format, elements = self._header()
        self.codes = {element.name: element.properties for element in elements}
        last = max((i for i, e in enumerate(elements) if trailer or e.name in wanted), default=-1)
        for element in elements[: last + 1]:
            if element.has_list:
                elsewhere = "write it after all others, or leave it out"
                remedy = _remedy(element.name) if element.name in wanted else elsewhere
                self.fail(f"element {_quote(element.name)} has a list property", remedy)
        all_fixed = not any(e.has_list for e in elements)
        fixed = elements if all_fixed else elements[: last + 1]

        left = self.size - self.file.tell()
        need = sum(e.least_bytes(file_format) for e in fixed)
        if need > left + (file_format == "ascii"):  # the last ASCII value may lack its separator
            promise = ", ".join(f"{e.count} x {_quote(e.name)}" for e in fixed[:_NAMED])
            promise += f" and {counted(len(fixed) - _NAMED, 'element')} more" if len(fixed) > _NAMED else ""
            self.fail(f"the header promises {promise} = {need} bytes or more, but only {left} bytes follow")
        if file_format == "ascii":
            return self._ascii(fixed, wanted, all_fixed)
        if all_fixed and need < left and not trailer:
            self.fail(f"{counted(left - need, 'byte')} of data left over after the last element")
        return self._binary(elements[: last + 1], wanted, _BYTE_ORDERS[file_format])

    def trailer(self) -> bytes:
        """What follows the last element, once the tables are read."""
        return self.file.read()

    def columns(
        self, table: Array, element: str, names: tuple[str, ...], least: float = -np.inf, most: float = np.inf
    ) -> Array:
        """Columns of a table by name as float32 [count, len(names)], all of them there, and finite if they have to be.

        ``least`` is what -∞ becomes, and ``most`` ∞, where that is no error.
        """
        out = np.empty((len(table), len(names)), np.float32)
        present = table.dtype.names or ()
        for i, name in enumerate(names):
            if name not in present:
                packed = "packed_position" in present
                remedy = "this is a compressed PLY, export it uncompressed" if packed else _remedy(element)
                self.fail(f'element "{element}" has no property "{name}"', remedy)
            with np.errstate(over="ignore", invalid="ignore"):  # doubles beyond float32 become inf: see below
                out[:, i] = table[name]
        if least > -np.inf or most < np.inf:
            np.clip(out, least, most, out=out, where=np.isinf(out))
        if self.finite:
            check_finite(self.path, element, names, out, NOT_FINITE if element == "vertex" else _DAMAGED)
        return out

    def rest_columns(self, table: Array, element: str, remedy: str = _DAMAGED) -> Array:
        """The columns f_rest_* of a table, as ``columns`` has them, [count, 3 (K - 1)], of SH degree 0 to 3.

        Of degree 4 what is above 3 is left out, and ``left_out`` says so.
        """
        n_rest = sum(name.startswith("f_rest_") for name in table.dtype.names or ())
        if n_rest == N_REST_4:
            self.left_out.append(SH_LEFT_OUT)
            of_each = np.array(rest_names(n_rest)).reshape(3, -1)  # channel-major
            return self.columns(table, element, tuple(of_each[:, : N_REST[3] // 3].ravel().tolist()))
        if n_rest not in N_REST:
            self.fail(f"{n_rest} properties f_rest_*, but SH degree 0, 1, 2, 3 has 0, 9, 24, 45", remedy)
        return self.columns(table, element, rest_names(n_rest))

    def _header(self) -> tuple[str, list[_Element]]:
        """The format name and all elements; leaves the file at the first byte of data."""
        if self.size == 0:
            self.fail("the file is empty", "export the model again")
        if self.file.readline(8).rstrip() != b"ply":
            self.fail('not a PLY file (its first line is not "ply")', NOT_3DGS)
        file_format = ""
        elements: dict[str, _Element] = {}
        latest = None
        while True:
            line = self.file.readline(_MAX_HEADER_BYTES)
            if not line.endswith(b"\n") or self.file.tell() > _MAX_HEADER_BYTES:
                self.fail('the header has no "end_header" line')
            words = [w.decode("ascii", "backslashreplace") for w in line.split()]
            match words:
                case ["comment", *rest]:
                    self.comments.append(" ".join(rest))
                case [] | ["obj_info", *_]:
                    continue
                case ["end_header"]:
                    break
                case ["format", name, "1.0"] if name in _BYTE_ORDERS and not file_format:
                    file_format = name
                case ["format", *_]:
                    self.fail(f"unsupported {_quote(*words)}", f"save it as one of {', '.join(_BYTE_ORDERS)}")
                case ["element", name, count] if count.isdecimal() and len(count) <= 18:
                    if name in elements:
                        self.fail(f"element {_quote(name)} is declared twice")
                    latest = elements[name] = _Element(name, int(count))
                case ["property", "list", _, _, _] if latest:
                    latest.has_list = True
                case ["property", code, name] if latest and code in _TYPES:
                    if name in latest.properties:
                        self.fail(f"property {_quote(name)} is declared twice")
                    latest.properties[name] = _TYPES[code]
                case _:
                    self.fail(f"header line {_quote(*words)} makes no sense")
        if not file_format:
            self.fail('the header has no "format" line')
        return file_format, list(elements.values())

    def _binary(self, elements: list[_Element], wanted: set[str], byte_order: str) -> dict[str, Array]:
        tables = {}
        for element in elements:
            dtype = element.dtype(byte_order)
            data = self.file.read(element.count * dtype.itemsize)
            if len(data) != element.count * dtype.itemsize:
                self.fail("the file became shorter while it was read")
            if element.name in wanted:
                tables[element.name] = np.frombuffer(data, dtype) if data else np.zeros(0, dtype)
        return tables

    def _ascii(self, elements: list[_Element], wanted: set[str], all_fixed: bool) -> dict[str, Array]:
        tables = {}
        words = iter(self.file.read().split())
        for element in elements:
            n_values = element.count * len(element.properties)
            try:
                values = np.array([float(w) for w in islice(words, n_values)])  # [count * columns]
            except ValueError:
                self.fail(f"element {_quote(element.name)} holds something that is not a number")
            if values.size != n_values:
                self.fail(f"element {_quote(element.name)} ends after {values.size} of {n_values} values")
            if element.name in wanted:
                dtype = np.dtype([(name, "f8") for name in element.properties])
                tables[element.name] = values.view(dtype) if n_values else np.zeros(0, dtype)
        if all_fixed and next(words, None) is not None:
            self.fail("data is left over after the last element")
        return tables


def check_finite(path: Path, element: str, names: tuple[str, ...], values: Array, remedy: str):
    """Raise ``DataError`` with the number of non-finite ``values`` [rows, len(names)] and the first one.

    Two elements may have columns of the same names, so that the error says which it is.
    """
    finite = np.isfinite(values)
    if not finite.all():
        row, column = np.argwhere(~finite)[0]
        count = finite.size - np.count_nonzero(finite)
        first = f'first "{names[column]}" in row {row} of the element "{element}"'
        raise DataError(path, f"has values that are not finite: {count}, the {first}", remedy)


def rest_names(n_rest: int) -> tuple[str, ...]:
    """Of the coefficients beyond degree 0, channel by channel."""
    return tuple(f"f_rest_{i}" for i in range(n_rest))


def in_unit(colors: Array, code: str) -> Array:
    """Colours [count, 3] of the columns ``RGB`` as float32 in 0..1; ``code`` is NumPy's of such a column in the header.

    Integer columns hold 0..255, or those of 16 bits 0..65535; floats hold 0..1, or 0..255. ASCII files are seen whose
    header says uchar and whose numbers are fractions.
    """
    brightest = colors.max(initial=0)
    whole = code[0] != "f" and np.array_equal(colors, np.rint(colors))
    full = MAX_COLOR if brightest > 255 else 255 if whole or brightest > 1 else 1
    return (colors / full).astype(np.float32)


def _remedy(element: str) -> str:
    """For one without columns that it should have: what others write is in ``vertex``, the rest in our files alone."""
    return NOT_3DGS if element == "vertex" else _DAMAGED


def _quote(*words: str) -> str:
    """Words of a foreign header, short and printable on one line."""
    text = " ".join(words)
    return ascii(text if len(text) <= 60 else text[:57] + "...").replace("'", '"')
