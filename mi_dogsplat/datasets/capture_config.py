"""All settings of a capture; ``capture.json`` in the data set's folder holds them, so that it can be resumed."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ..support.errors import DataError

UPS = ("auto", "x", "y", "z", "-x", "-y", "-z")
PATHS = ("orbit", "hemisphere", "sensors")
DEPTHS = ("none", "exr", "npy")
ELEVATIONS = {"orbit": (12.0, 65.0), "hemisphere": (0.0, 90.0)}
CIRCLING_ONLY = ("views", "size", "fov", "up", "elevations", "zoom", "center", "radius")
RANGES = {
    "views": (1, math.inf),
    "test": (0, math.inf),
    "spp": (1, math.inf),
    "seed": (0, 2**31 - 1),
    "fov": (0.1, 170),
    "zoom": (1e-3, 1e3),
    "radius": (1e-30, 1e30),
    "downscale": (1, math.inf),
    "points": (0, math.inf),
}


@dataclass(frozen=True)
class CaptureConfig:
    """Where cameras stand and what they record; the comment of a field is the help text of its flag.

    Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed.
    """

    path: str = "hemisphere"  # orbit, hemisphere, sensors (the scene's own), or a JSON file of cameras
    views: int = 48  # training views of an orbit or hemisphere
    test: int | None = None  # test views, spread evenly (default: a sixth as many; of sensors or a file every 8th)
    size: tuple[int, int] = (400, 400)  # width and height in pixels
    fov: float = 40.0  # field of view of the longer side, in degrees
    spp: int = 64  # samples per pixel, rounded up to a square number
    seed: int = 0  # seed of samples and points
    up: str = "auto"  # vertical axis: x, y, z, -x, -y, -z (as --up=-y), or auto: that of the scene's first sensor
    elevations: tuple[float, float] | None = None  # lowest and highest, degrees (default: orbit 12 65, hemisphere 0 90)
    zoom: float = 1.0  # at 1 the bounding sphere just fits, at 2 it is twice as large
    center: tuple[float, float, float] | None = None  # what an orbit looks at (default: the middle of the shapes)
    radius: float | None = None  # of the sphere to frame (default: that around the shapes)
    downscale: int = 1  # divide the size of sensors or of a file's cameras by this
    alpha: bool = False  # transparent background; lamps and environment are hidden from the cameras
    depth: str = "none"  # also write depth, along the view axis: exr (float32, Blender) or npy (nerfstudio)
    points: int = 20_000  # initial points on the surfaces, as many as the cameras see; 0: none

    def __post_init__(self) -> None:
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:  # NaN is in no range
                wanted = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
                refuse(name, f"{value} is out of range", f"use {wanted}")
        for name, choices in (("up", UPS), ("depth", DEPTHS)):
            if getattr(self, name) not in choices:
                refuse(name, f'"{getattr(self, name)}" is unknown', "use " + ", ".join(choices))
        if self.path not in PATHS and not self.path.lower().endswith(".json"):
            refuse("path", f'"{self.path}" is unknown', f"use {', '.join(PATHS)}, or a .json file of cameras")
        if min(self.size) < 1:
            refuse("size", f"{self.size[0]} x {self.size[1]} has no pixels", "use at least 1 x 1")
        if self.elevations and not -90 <= self.elevations[0] <= self.elevations[1] <= 90:
            refuse("elevations", f"{self.elevations[0]:g} {self.elevations[1]:g} is no band", "ascend within -90 to 90")
        if self.elevations and self.elevations[0] == self.elevations[1] and abs(self.elevations[0]) == 90:
            refuse("elevations", "all cameras would stand at the pole", "use a band")
        if self.center and not all(map(math.isfinite, self.center)):
            refuse("center", f"{self.center} is no point", "use three numbers")
        self._refuse_what_is_not_used()

    @property
    def circling(self) -> bool:
        """Whether the cameras are made here, around the scene, instead of given."""
        return self.path in ELEVATIONS

    @property
    def band(self) -> tuple[float, float]:
        """Elevations of an orbit or hemisphere in degrees."""
        return self.elevations or ELEVATIONS[self.path]

    def _refuse_what_is_not_used(self) -> None:
        defaults = {field.name: field.default for field in fields(self)}
        unused = ("downscale",) if self.circling else CIRCLING_ONLY
        for name in unused:
            if getattr(self, name) != defaults[name]:
                owner = "an orbit or a hemisphere has --size" if self.circling else "given cameras have their own"
                refuse(name, f"is not for --path {self.path}", f"leave it out: {owner}")


def refuse(name: str, problem: str, remedy: str) -> None:
    """Raise the ``DataError`` for a setting, named as its flag."""
    raise DataError("--" + name, problem, remedy)
