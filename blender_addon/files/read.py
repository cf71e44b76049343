"""Models of every format: PLY and SPZ by readers of our own, all others by the package, which makes a PLY of them."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from .errors import FileError
from .light import Light, spz_radiance
from .model import Model
from .ply import read_comments, read_ply
from .spz import GZIP, gzip_comments, read_spz

EXTENSIONS = (".ply", ".spz", ".sog", ".glb", ".gltf", ".splat", ".json")  # .json: the meta.json of SOG
RENDER_MODES = {"mip": True, "default": False}
UP_AXES = ("X", "-X", "Y", "-Y", "Z", "-Z")
Converter = Callable[[Path, Path], None]  # any model to a PLY, DoG and comments kept; raises ``FileError``


@dataclass(frozen=True)
class Said:
    """What a file says on how its model is to be drawn; None where it says nothing."""

    antialiased: bool | None = None
    near_clip: float | None = None
    linear: bool | None = None
    up: tuple[float, float, float] | None = None  # a direction of any length
    scale: float | None = None
    white: float | None = None  # linear radiance

    @property
    def light(self) -> Light:
        """What the colours mean."""
        return Light(bool(self.linear), self.white or 1.0)


def read_model(path: str | Path, convert: Converter) -> tuple[Model, Said]:
    """Read a model of any format. Raises ``FileError``; ``convert`` is asked for what is neither PLY nor SPZ 2 or 3."""
    path = Path(path)
    if path.is_dir():
        raise FileError(path, "this is a folder", "give the path of a model")
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        remedy = "check the path and its permissions"
        raise FileError(path, "cannot be read ({reason})", remedy, reason=error.strerror) from error
    if head[:2] == GZIP:
        model, antialiased = read_spz(path)
        comments = gzip_comments(head)
        said = replace(said_in(comments), antialiased=antialiased)
        return spz_radiance(model, said.light, comments) if said.linear else model, said
    is_ply, packed = head[:3] == b"ply", b"packed_position" in head
    if (is_ply and not packed) or (path.suffix.lower() == ".ply" and not is_ply):  # its reader knows what is wrong
        return read_ply(path), said_in(read_comments(path))
    with tempfile.TemporaryDirectory(prefix="dogsplat_") as folder:
        plain = Path(folder) / "model.ply"
        convert(path, plain)
        return read_ply(plain), said_in(read_comments(plain))


def said_in(comments: list[str]) -> Said:
    """What the comments of a PLY header say; ours come before those of others, nonsense is passed over."""
    ours: dict[str, object] = {}
    others: dict[str, object] = {}
    for comment in comments:
        match comment.split():
            case ["dogsplat", "antialiased" | "linear" as name, "true" | "false" as value]:
                ours[name] = value == "true"
            case ["dogsplat", "up", name] if (up := direction(name)) is not None:
                ours["up"] = up
            case ["dogsplat", "scale" | "white" as name, number] if _positive(number):
                ours[name] = float(number)
            case ["dogsplat", "near_clip", number] if _positive(number, or_zero=True):
                ours["near_clip"] = float(number)
            case ["SplatRenderMode:", mode] if mode in RENDER_MODES:
                others["antialiased"] = RENDER_MODES[mode]
            case ["Vertical", "axis:", axis] if axis.lower() in ("y", "z"):  # of Brush, which means down
                others["up"] = direction(f"-{axis}")
    return Said(**others | ours)  # type: ignore[arg-type]


def direction(name: str) -> tuple[float, float, float] | None:
    """The vector of an axis, as ``-y``, or of three numbers, ``0.1,-0.9,0.4``; None for anything else."""
    if name.upper() in UP_AXES:
        x, y, z = (float(axis == name[-1].upper()) * (-1 if name[0] == "-" else 1) for axis in "XYZ")
        return x, y, z
    try:
        x, y, z = (float(word) for word in name.split(","))
    except ValueError:
        return None
    return (x, y, z) if 1e-6 < math.hypot(x, y, z) < 1e6 else None


def _positive(text: str, or_zero: bool = False) -> bool:
    try:
        number = float(text)
    except ValueError:
        return False
    return 0 < number < float("inf") or (or_zero and number == 0)
