"""All settings of a capture; ``capture.json`` in the data set's folder holds them, so that it can be resumed."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Annotated

from ..support.settings import Setting, check_settings, refuse

UPS = ("auto", "x", "y", "z", "-x", "-y", "-z")
PATHS = ("orbit", "hemisphere", "sensors")
DEPTHS = ("none", "exr", "npy")
ELEVATIONS = {"orbit": (12.0, 65.0), "hemisphere": (0.0, 90.0)}
CIRCLING_ONLY = ("views", "size", "fov", "up", "elevations", "zoom", "center", "radius")
CAMERAS = "places of the cameras: orbit, hemisphere, sensors (the scene's own), or a JSON file of cameras"
TESTS = (
    "number of test views, spread evenly; with 0 none are named, and a training takes every 8th view (default: a sixth "
    "as many as training views; for sensors or a file every 8th)"
)
VERTICAL = "axis that points up: x, y, z, -x, -y, -z (write --up=-y), or auto: that of the scene's first sensor"
BAND = "lowest and highest elevation of the cameras, in degrees (default: 12 65 for orbit, 0 90 for hemisphere)"
CENTER = "point that an orbit or hemisphere looks at (default: the middle of the shapes)"
ALPHA = "transparent background; the cameras do not see lamps and environment"
HDR = "write linear radiance as OpenEXR (half floats), to train a linear model"
DEPTH = "also write depth along the view axis: exr (float32, for Blender) or npy (for nerfstudio)"


@dataclass(frozen=True)
class CaptureConfig:
    """Where cameras stand and what they record; what stands beside a field's type is the help text of its flag.

    Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed.
    """

    path: Annotated[str, Setting(CAMERAS, "NAME_or_JSON")] = "hemisphere"
    views: Annotated[int, Setting("number of training views of an orbit or hemisphere", least=1)] = 48
    test: Annotated[int | None, Setting(TESTS, least=0)] = None
    size: Annotated[tuple[int, int], Setting("width and height in pixels", "W H")] = (400, 400)
    fov: Annotated[
        float, Setting("field of view of the longer side, in degrees", "DEGREES", least=0.1, most=170)
    ] = 40.0
    spp: Annotated[int, Setting("samples per pixel, rounded up to a square number", least=1)] = 64
    seed: Annotated[int, Setting("seed of samples and points", least=0, most=2**31 - 1)] = 0
    up: Annotated[str, Setting(VERTICAL, "AXIS", choices=UPS)] = "auto"
    elevations: Annotated[tuple[float, float] | None, Setting(BAND, "LOW HIGH")] = None
    zoom: Annotated[
        float, Setting("with 1 the bounding sphere just fits, with 2 it is twice as large", least=1e-3, most=1e3)
    ] = 1.0
    center: Annotated[tuple[float, float, float] | None, Setting(CENTER, "X Y Z")] = None
    radius: Annotated[
        float | None, Setting("radius of what to frame (default: that of the shapes)", "R", least=1e-30, most=1e30)
    ] = None
    downscale: Annotated[int, Setting("divide the size of sensors or of a file's cameras by this", "K", least=1)] = 1
    alpha: Annotated[bool, Setting(ALPHA)] = False
    hdr: Annotated[bool, Setting(HDR)] = False
    depth: Annotated[str, Setting(DEPTH, "FORMAT", choices=DEPTHS)] = "none"
    points: Annotated[
        int, Setting("number of initial points, on surfaces and dense splats that the cameras see; 0: none", least=0)
    ] = 20_000

    def __post_init__(self) -> None:
        check_settings(self)
        if self.path not in PATHS and not self.path.lower().endswith(".json"):
            refuse("path", f'"{self.path}" is unknown', f"use {', '.join(PATHS)}, or a .json file of cameras")
        if min(self.size) < 1:
            refuse("size", f"{self.size[0]} x {self.size[1]} has no pixels", "use at least 1 x 1")
        if self.elevations and not -90 <= self.elevations[0] <= self.elevations[1] <= 90:
            low, high = self.elevations
            refuse("elevations", f"{low:g} {high:g} is not a range", "give the lower one first, within -90 to 90")
        if self.elevations and self.elevations[0] == self.elevations[1] and abs(self.elevations[0]) == 90:
            refuse("elevations", "all cameras would stand at the pole", "use a range of elevations")
        if self.center and not all(map(math.isfinite, self.center)):
            refuse("center", f"{self.center} is not a point", "use three numbers")
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
