"""The formats by name: how each is read and written, and what of a model it holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..scene.drawing import NAMES, comments_of, drawing_of
from ..scene.ply import read_ply_and_comments, write_ply
from ..scene.splats import Array, Splats
from ..support.errors import DataError
from ..support.files import write_bytes
from . import compressed_ply, gltf, gltf_read, sog, sog_read, splat, spz, usd, usd_files, usd_read
from .model import Model
from .packing import LUF, RUB, Turn, by_color, in_space

ALL = frozenset(NAMES)


@dataclass(frozen=True)
class Format:
    """A format; readers and writers have the axes of the file, which ``turn`` takes from those of 3DGS PLY, or back.

    carries: fields of ``Drawing`` that it can say. dog, slopes, cuts, shifts, mixed_sh: it holds DoG primitives,
    colours that vary over theirs, primitives that a plane cuts off, places that depend on the view, SH degrees of
    single ones. empty: it may hold no primitive at all. sh_degree: the highest that it holds.
    order: in which primitives compress best; None: it does not matter. in_white: linear colours are in units of white
    in the file, as its codes are made for 0 to 1. colors, radiance: the least and the greatest mean colour that it can
    say, where 1 is white, of display-referred and of linear models.
    largest_sh: of coefficients of view-dependent colour, of either sign, in the units of the file.
    log_scales: the least and the greatest that it can say. moved: which primitives [N] it puts elsewhere, by more than
    their size, as it has these ``bits`` for places.
    """

    name: str
    read: Callable[[Path], Model]
    write: Callable[[Path, Model], None]
    carries: frozenset[str] = frozenset()
    turn: Turn | None = None
    dog: bool = False
    slopes: bool = False
    cuts: bool = False
    shifts: bool = False
    mixed_sh: bool = False
    empty: bool = True
    sh_degree: int = 3
    order: Callable[[Splats], Array] | None = None
    in_white: bool = False
    colors: tuple[float, float] = (-math.inf, math.inf)
    radiance: tuple[float, float] = (-math.inf, math.inf)
    largest_sh: float = math.inf
    log_scales: tuple[float, float] = (-math.inf, math.inf)
    moved: Callable[[Splats], Array] | None = None
    bits: str = ""


def _read_ply(path: Path) -> Model:
    return read_any_ply(path, finite=True)


def read_any_ply(path: Path, finite: bool = False) -> Model:
    """The content of a PLY, whose numbers need not be ``finite``. Raises ``DataError``."""
    splats, comments, left_out = read_ply_and_comments(path, finite)
    return Model(splats, drawing_of(comments), tuple(left_out))


def _written(encode: Callable[[Model], bytes]) -> Callable[[Path, Model], None]:
    return lambda path, model: write_bytes(path, encode(model))


LIGHT = frozenset({"antialiased", "linear", "white"})
PLY = Format(
    "PLY",
    _read_ply,
    lambda path, model: write_ply(path, model.splats, "rows", comments_of(model.drawing)),
    ALL,
    dog=True,
    slopes=True,
    cuts=True,
    shifts=True,
    mixed_sh=True,
)
COMPRESSED_PLY = Format(
    "compressed PLY",
    compressed_ply.read,
    _written(lambda model: compressed_ply.encode(model.splats, comments_of(model.drawing))),
    ALL,
    dog=True,
    slopes=True,
    cuts=True,
    shifts=True,
    order=in_space,
    in_white=True,
    largest_sh=compressed_ply.SH_RANGE / 2,
    log_scales=(-compressed_ply.MAX_LOG_SCALE, compressed_ply.MAX_LOG_SCALE),
    moved=compressed_ply.moved,
    bits=f"10 or 11 bits for a coordinate among {compressed_ply.CHUNK} neighbours",
)
SPZ = Format(
    "SPZ",
    spz.read,
    _written(lambda model: spz.encode(model.splats, model.drawing)),
    LIGHT,
    RUB,
    order=by_color,
    in_white=True,
    colors=spz.COLORS,
    radiance=spz.RADIANCE,
    largest_sh=1.0,
    log_scales=spz.LOG_SCALES,
    moved=spz.moved,
    bits="24 bits for a coordinate",
)
SOG = Format(
    "SOG",
    sog_read.read,
    _written(lambda model: sog.encode(model.splats, model.drawing)),
    ALL,
    order=in_space,
    in_white=True,
    moved=sog.moved,
    bits="16 bits for the logarithm of a coordinate",
)
GLB, GLTF = (
    Format(
        "glTF",
        gltf_read.read,
        partial(gltf.write, binary=binary),
        ALL,
        LUF,
        empty=False,  # its accessors have a row at least
    )
    for binary in (True, False)
)
USD = Format(
    "OpenUSD",
    usd_read.read,
    lambda path, model: usd.write(path, model.splats, model.drawing),
    ALL,
    RUB,
)
SPLAT = Format(
    ".splat",
    splat.read,
    _written(lambda model: splat.encode(model.splats)),
    sh_degree=0,
    in_white=True,
    colors=(0.0, 1.0),
    radiance=(0.0, 1.0),
)

FORMATS = {  # by the end of the file's name; the longer one first
    ".compressed.ply": COMPRESSED_PLY,
    ".ply": PLY,
    ".spz": SPZ,
    ".sog": SOG,
    ".glb": GLB,
    ".gltf": GLTF,
    **dict.fromkeys(usd_files.NAMES, USD),
    ".splat": SPLAT,
}


def format_to_write(path: Path, others: Sequence[str] = ()) -> Format:
    """The format that the name of a file asks for. Raises ``DataError``, which lists ``others`` too."""
    for suffix, chosen in FORMATS.items():
        if path.name.lower().endswith(suffix):
            return chosen
    raise DataError(path, "no known format", f"name a file that ends in {', '.join((*FORMATS, *others))}")
