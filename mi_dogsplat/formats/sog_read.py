"""Reading SOG: a bundle (.sog) or a folder of pictures beside their meta.json; ``sog.py`` tells the layout.

Version 1, whose meta.json names no version, has no tables: its codes are shares between bounds, ``mins`` and ``maxs``.
Those of scales and of ``sh0`` are of each channel, where the fourth is the logit of the opacity; those of ``shN`` are
of all coefficients. The number of primitives is that of ``shape``, and the width of the palette's picture tells the SH
degree. Facts: the reader of github.com/playcanvas/splat-transform (MIT).
"""

from __future__ import annotations

import io
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.drawing import Drawing, drawing_of_extras, value_of
from ..scene.quaternions import XYZW_FROM_WXYZ
from ..scene.splats import Array, Splats
from ..support.errors import DAMAGED, DataError
from ..support.files import parse_json
from ..support.wording import counted
from .limits import require_proportion
from .model import Model
from .packing import SQRT2, from_smallest_three, logits, signed_exp

FIRST_TAG = 252
PER_ROW = 64  # entries of the palette
META = "meta.json"
SH_SIZES = (0, 3, 8, 15)  # coefficients by ``bands``, without the first
VERSIONS = (1, 2)  # that are read
NUMBERS = 14  # of a primitive without ``rest``; a code each, as the bytes of SPZ are counted


def read(path: Path) -> Model:
    """The content of a bundle, or of the folder of a meta.json. Raises ``DataError``."""
    try:
        if zipfile.is_zipfile(path):
            size = path.stat().st_size
            with zipfile.ZipFile(path) as bundle:
                folder = _folder_of_meta(path, bundle.namelist())
                return _read(path, size, lambda name: _unpacked(path, size, bundle, folder + name))
        if path.suffix.lower() == ".sog":
            raise DataError(path, "is not a SOG model: it is not a ZIP file, or only a part of one", DAMAGED)
        files = _Folder(path)
        return _read(path, files.size(), files.content)
    except DataError:
        raise
    except ImportError:
        raise DataError(path, "SOG needs the package Pillow", "pip install 'mi_dogsplat[export]'") from None
    except (
        OSError, EOFError, zipfile.BadZipFile, KeyError, ValueError, IndexError, TypeError, AttributeError,
        NotImplementedError, RuntimeError, OverflowError, SyntaxError,  # of zipfile and Pillow
    ) as error:  # fmt: skip
        problem = f"is not a SOG model ({type(error).__name__}: {error})"
        raise DataError(path, problem, DAMAGED) from error


def _folder_of_meta(path: Path, names: list[str]) -> str:
    """The folder of a ZIP file in which its model lies, with a slash; empty: not in one. Raises ``DataError``."""
    inside = [name.removesuffix(META) for name in names if name.split("/")[-1] == META and name.count("/") < 2]
    if not inside:
        raise DataError(path, f"is a ZIP file without {META}, and so no SOG model", "give another file")
    if "" not in inside and len(inside) > 1:
        raise DataError(path, f"is a ZIP file of several models: {', '.join(inside)}", f"unpack it and give one {META}")
    return min(inside, key=len)


def files_beside(path: Path) -> list[Path]:
    """The pictures that a meta.json names, of a model that was read; none of a bundle."""
    if zipfile.is_zipfile(path):
        return []
    parts = [part for part in parse_json(path.read_text(encoding="utf-8-sig")).values() if isinstance(part, dict)]
    names = {name for part in parts for name in part.get("files", ()) if isinstance(name, str)}
    return [path.parent / name for name in sorted(names) if Path(name).name == name]


def _unpacked(path: Path, size: int, bundle: zipfile.ZipFile, name: str) -> bytes:
    info = bundle.getinfo(name)
    if info.compress_size > size:  # zipfile would make room for all of it first
        raise ValueError(f'"{name}" claims {info.compress_size} bytes of a file of {size}')
    require_proportion(path, info.file_size, info.compress_size)
    return bundle.read(info)


@dataclass
class _Folder:
    """The files beside a meta.json."""

    meta: Path

    def content(self, name: str) -> bytes:
        if name == META:
            return self.meta.read_bytes()
        if Path(name).name != name:
            raise ValueError(f'"{name}" is not the name of a file beside it')
        return (self.meta.parent / name).read_bytes()

    def size(self) -> int:
        return sum(file.stat().st_size for file in self.meta.parent.glob("*.*") if file.is_file())


@dataclass(frozen=True)
class _Parts:
    """The parts of a model of N primitives by their names in ``meta``; ``content`` gives the bytes of a file."""

    path: Path
    size: int
    content: Callable[[str], bytes]
    meta: Any
    first: bool  # version 1
    n: int

    def picture(self, part: str, which: int = 0) -> Array:
        """[H, W, 4]"""
        return _pixels(self.path, self.size, self.content(self.meta[part]["files"][which]))

    def pixels(self, part: str, which: int = 0) -> Array:
        """[N, 4]"""
        found = self.picture(part, which).reshape(-1, 4)
        if len(found) < self.n:
            problem = f'{counted(self.n, "primitive")}, but a picture of "{part}" has {len(found)} pixels'
            raise ValueError(problem)
        return found[: self.n]

    def bounds(self, part: str, ends: int | None = None) -> tuple[Array, Array]:
        """Least and largest values; ``ends``: how many there are of each, None for one in all."""
        said = (self.meta[part][end] for end in ("mins", "maxs"))
        low, high = (_numbers([value] if ends is None else value, ends) for value in said)
        return low, high

    def values(self, part: str, codes: Array, ends: int | None = None) -> Array:
        """What the codes of a part stand for; ``ends``: as of ``bounds``, which version 1 has."""
        if not self.first:
            return _table(self.meta[part]["codebook"])[codes]
        low, high = self.bounds(part, ends)
        used = slice(codes.shape[-1])
        return low[used] + (high[used] - low[used]) * codes / 255


def _read(path: Path, size: int, content: Callable[[str], bytes]) -> Model:
    meta = parse_json(content(META).decode("utf-8-sig"))  # editors of Windows begin a file with a mark
    version = meta.get("version", 1)
    if version not in VERSIONS:
        raise DataError(path, f"is SOG of version {version}", "convert it to version 2")
    first = version == 1
    n = meta["means"]["shape"][0] if first else meta["count"]
    if not isinstance(n, int) or isinstance(n, bool) or n < 0:
        raise ValueError(f"its number of primitives is {n}")
    parts = _Parts(path, size, content, meta, first, n)
    has_rest = "shN" in meta
    palette = parts.picture("shN")[..., :3] if has_rest else np.zeros((0, 0, 3), np.uint8)  # [rows, 64 (K - 1), 3]
    rest = SH_SIZES[meta["shN"].get("bands", 3)] if has_rest and not first else palette.shape[1] // PER_ROW
    if rest not in SH_SIZES:
        raise ValueError(f'a picture of "shN" is {palette.shape[1]} pixels wide')
    require_proportion(path, n * (NUMBERS + 3 * rest), size)
    low, high = parts.bounds("means", 3)
    logs = low + (high - low) * (parts.pixels("means", 0)[:, :3] + 256.0 * parts.pixels("means", 1)[:, :3]) / 65535
    quats, sh0 = parts.pixels("quats"), parts.pixels("sh0")
    if n and quats[:, 3].min() < FIRST_TAG:
        raise ValueError("a quaternion names no component as its largest")
    sh = parts.values("sh0", sh0[:, :3], 4)[:, None]  # [N, 1, 3]
    if rest:
        entries = palette.reshape(-1, rest, 3) if palette.shape[1] == PER_ROW * rest else palette[:0]
        label = parts.pixels("shN", 1).astype(np.int64)
        codes = entries[label[:, 0] + 256 * label[:, 1]]
        sh = np.concatenate([sh, parts.values("shN", codes).reshape(n, rest, 3)], axis=1)
    wxyz = from_smallest_three(quats[:, 3].astype(np.int64) - FIRST_TAG, (quats[:, :3] / 127.5 - 1) / SQRT2)
    splats = Splats(
        means=signed_exp(logs),
        log_scales=parts.values("scales", parts.pixels("scales")[:, :3], 3),
        quats=wxyz[:, XYZW_FROM_WXYZ],
        logit_opacities=parts.values("sh0", sh0, 4)[:, 3] if first else logits(sh0[:, 3] / 255),
        sh_coeffs=sh,
    )
    antialias = value_of("antialiased", meta.get("antialias"))
    return Model(splats, drawing_of_extras(meta.get("extras")).over(Drawing(antialias)))


def _numbers(values: Any, count: int | None = None) -> Array:
    found = np.array(values, np.float64)
    if found.ndim != 1 or (count and len(found) != count):
        raise ValueError(f"a list of {count or ''} numbers expected, found {str(values)[:40]}")
    return found


def _table(values: Any) -> Array:
    """A codebook. splat-transform has written null, its JSON of -∞ or NaN, for the first of increasing values.

    PlayCanvas takes one mean step below the second for it, and so does this.
    """
    if isinstance(values, list) and len(values) > 2 and values[0] is None:
        values = [values[1] - (values[-1] - values[1]) / (len(values) - 1), *values[1:]]
    return _numbers(values)


def _pixels(path: Path, size: int, data: bytes) -> Array:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # of what the next line refuses
            picture = Image.open(io.BytesIO(data))
    except Image.DecompressionBombError as error:
        raise ValueError(error) from None
    with picture:
        require_proportion(path, picture.width * picture.height * 4, size)
        return np.asarray(picture.convert("RGBA"))  # an opaque one may have lost its alpha
