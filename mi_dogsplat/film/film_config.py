"""All settings of a film."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..support.settings import Setting, check_settings, is_said, refuse
from .camera_path import LEAST_FPS, MOST_FPS
from .usd_path import is_usd_path

PATHS = ("auto", "orbit", "cameras")
ONLY_FOR = {"elevation": "orbit", "zoom": "orbit", "smoothing": "cameras"}  # flags of one path
PATH = "path: orbit, cameras (of the data or scene, smoothed), a JSON of key frames, a .usd with a camera, or auto"
SECONDS = "length of the film in seconds (default: 10, or what the key frames say)"
FPS = "frames per second (default: 30, or what the .usd of --path says)"
SIZE = "width and height in pixels (default: those of the path or of the scene, else 1280 720)"
FOV = "field of view of the shorter side, in degrees (default: 40, or that of the cameras)"
ELEVATION = "elevation of an orbit above the horizon, in degrees (default: 25, or that of the cameras)"
SMOOTHING = "for --path cameras: standard deviation of the smoothing, in cameras; 0: the path leads through each one"


@dataclass(frozen=True)
class FilmConfig:
    """Where the camera goes, and how its pictures become a film.

    Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed.
    """

    path: Annotated[str, Setting(PATH, "NAME_or_FILE")] = "auto"
    seconds: Annotated[float | None, Setting(SECONDS, "S", least=1e-3, most=86_400)] = None
    fps: Annotated[int | None, Setting(FPS, least=LEAST_FPS, most=MOST_FPS)] = None
    size: Annotated[tuple[int, int] | None, Setting(SIZE, "W H")] = None
    fov: Annotated[float | None, Setting(FOV, "DEGREES", least=0.1, most=170)] = None
    elevation: Annotated[float | None, Setting(ELEVATION, "DEGREES", least=-89, most=89)] = None
    zoom: Annotated[float, Setting("for an orbit: 2 makes it half as wide", least=1e-3, most=1e3)] = 1.0
    smoothing: Annotated[float, Setting(SMOOTHING, least=0, most=1e3)] = 2.0
    shutter: Annotated[
        float, Setting("motion blur: share of a frame's time in which the shutter is open; 0: none", least=0, most=1)
    ] = 0.0
    samples: Annotated[int, Setting("pictures that are averaged into a blurred frame", least=2, most=1024)] = 8
    crf: Annotated[int, Setting("quality of the video: 0 is lossless, 51 the worst", least=0, most=51)] = 18

    def __post_init__(self) -> None:
        check_settings(self)
        if self.path not in PATHS and not self.path.lower().endswith(".json") and not is_usd_path(self.path):
            refuse("path", f'"{self.path}" is unknown', f"use {', '.join(PATHS)}, a .json of key frames, or a .usd")
        if self.size and not 1 <= min(self.size) <= max(self.size) <= 16_384:
            refuse("size", f"{self.size[0]} x {self.size[1]} is out of range", "use 1 to 16384 pixels")
        if self.path != "auto":
            self.require_for(self.path)
        if is_said(self, "samples") and not self.shutter:
            refuse("samples", "is for motion blur, and there is none", "add --shutter, or leave it out")

    def require_for(self, path: str) -> None:
        """Raise ``DataError`` for a setting of another path than that which the camera takes."""
        for name, other in ONLY_FOR.items():
            if path != other and is_said(self, name):
                refuse(name, f"is not for --path {path}", f"leave it out, or use --path {other}")
