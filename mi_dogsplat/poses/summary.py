"""What was found, in numbers (``summary.json``) and in words."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ..support.wording import counted, duration

MOST_NAMES = 5


@dataclass(frozen=True)
class Summary:
    """``error``: mean reprojection error in pixels; ``cameras``: a line each; ``without_pose``: names of images;
    ``up_from``: how up was found; ``scale``: metres of a unit, None where nobody knows; ``advice``: see ``advice.py``;
    ``seconds`` by stage, of this start and those before."""

    n_images: int
    n_registered: int
    n_points: int
    error: float
    observations: float
    cameras: list[str]
    n_masks: int
    without_pose: list[str]
    advice: list[str]
    seconds: dict[str, float]
    up_from: str = "as the cameras were held"
    scale: float | None = None

    def lines(self) -> list[str]:
        """Sentences for people."""
        lines = [
            f"{self.n_registered} of {self.n_images} images have a pose; {counted(self.n_points, 'point')}, "
            f"reprojection error {self.error:.2f} px, {self.observations:.0f} observations per image"
        ]
        lines += [f"camera: {camera}" for camera in self.cameras]
        unit = "of structure from motion; --scale makes it metres" if self.scale is None else "a metre"
        lines.append(f"up is -y, {self.up_from}; the unit is {unit}")
        if self.n_masks:
            lines.append(f"{counted(self.n_masks, 'mask')}; train with --masks masks/ of this folder")
        if self.without_pose:
            named = ", ".join(self.without_pose[:MOST_NAMES])
            more = len(self.without_pose) - MOST_NAMES
            lines.append(f"without a pose: {named}" + (f" and {more} more" if more > 0 else ""))
        lines += [f"warning: {sentence}" for sentence in self.advice]
        stages = ", ".join(f"{name} {duration(seconds)}" for name, seconds in self.seconds.items())
        return [*lines, f"time: {stages}"]


def camera_line(camera: Any) -> str:
    """``SIMPLE_RADIAL 4032x3024, focal length 3021 px (67° wide, 53° high), lens -0.012`` of one of pycolmap's."""
    focal, lens = camera.mean_focal_length(), [f"{camera.params[i]:.3g}" for i in camera.extra_params_idxs()]
    size = f"{camera.model_name} {camera.width}x{camera.height}"
    wide, high = (_field_of_view(camera, side) for side in (camera.width, camera.height))
    line = f"{size}, focal length {focal:.0f} px ({wide:.0f}° wide, {high:.0f}° high)"
    return line + (f", lens {' '.join(lens)}" if lens else "")


def field_of_view(camera: Any) -> float:
    """Along the longer side, in degrees, by the focal length alone."""
    return _field_of_view(camera, max(camera.width, camera.height))


def _field_of_view(camera: Any, side: int) -> float:
    half = side / 2 / camera.mean_focal_length()
    return math.degrees(2 * (half if "FISHEYE" in camera.model_name else math.atan(half)))
