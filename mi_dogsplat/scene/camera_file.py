"""A camera as a small JSON file, for ``dogsplat render --camera``.

.. code-block:: json

    {"w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]],
     "fx": 500, "fy": 500, "cx": 320, "cy": 240, "width": 640, "height": 480}

``w2c`` is the OpenCV world-to-camera matrix (x right, y down, z forward; rigid); lengths are in pixels, and
the centre of the top left pixel is (0.5, 0.5). ``fy`` may be left out where pixels are square, ``cx`` and
``cy`` where the principal point is in the middle. Other keys are ignored.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..support.errors import DataError
from ..support.files import read_json, replacing
from ..support.json_values import number_in
from .cameras import Camera, nearest_rigid, require_pixels

MOST_PIXELS = 16_384  # of a side, as of a film
LARGEST = 1e30  # of positions and lengths: kernels compute in float32
FORMAT = 'write {"w2c": 4x4 world to camera (OpenCV axes), "fx", "fy", "cx", "cy", "width", "height"}'


def read_camera(path: str | Path) -> Camera:
    """The camera in a file. Raises ``DataError`` for what is missing, not a number, or no rigid pose."""
    path = Path(path)
    try:
        return camera_in_file(read_json(path, FORMAT))
    except (ValueError, TypeError, OverflowError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(path, str(error), FORMAT) from error


def camera_in_file(content: Any) -> Camera:
    """The camera that an object of a file describes, which somebody may have written in other units.

    Raises what ``camera_from_json`` does.
    """
    camera = camera_from_json(content)
    require_pixels(camera.cx, camera.cy, camera.width, camera.height)
    return camera


def camera_from_json(content: Any, mirror: bool = False) -> Camera:
    """The camera that a JSON object describes; ``mirror`` admits one that sees a mirror image.

    Raises ``ValueError`` or ``TypeError`` where it does not.
    """
    if not isinstance(content, dict):
        raise ValueError("is not a JSON object")
    missing = [name for name in ("w2c", "fx", "width", "height") if name not in content]
    if missing:
        raise ValueError(f'lacks "{missing[0]}"')
    width, height = number_in(content, "width"), number_in(content, "height")
    if not (width.is_integer() and height.is_integer()):
        raise ValueError(f"width {width:g} and height {height:g} must be whole numbers of pixels")
    if max(width, height) > MOST_PIXELS:
        raise ValueError(f"width {width:.0f} and height {height:.0f} are too large: at most {MOST_PIXELS} pixels each")
    fx = number_in(content, "fx")
    fy = number_in(content, "fy", fx)
    cx, cy = number_in(content, "cx", width / 2), number_in(content, "cy", height / 2)
    camera = Camera(nearest_rigid(content["w2c"], mirror), fx, fy, cx, cy, int(width), int(height))
    if (largest := max(map(abs, (*camera.w2c[:3, 3], fx, fy, cx, cy)))) > LARGEST:
        raise ValueError(f"the pose or a length in pixels has {largest:g}: at most {LARGEST:g} can be drawn")
    return camera


def write_camera(path: str | Path, camera: Camera) -> None:
    """Write a camera; ``read_camera`` gives back the same numbers. Raises ``DataError``."""
    names = ("fx", "fy", "cx", "cy", "width", "height")
    content = {"w2c": camera.w2c.tolist()} | {name: getattr(camera, name) for name in names}
    try:
        with replacing(path) as part:
            part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise DataError(path, f"cannot be written ({error.strerror})", "check the folder") from error
