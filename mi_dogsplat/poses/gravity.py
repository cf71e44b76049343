"""Where down was when a photograph was taken, as far as its file says.

Three kinds of cameras write it down. Phones by Apple keep the acceleration in their maker note: a TIFF directory with
offsets of its own. Drones by DJI keep pitch and roll of the camera in XMP. And EXIF 2.31 has a tag for the elevation of
the camera. Videos tell quarter turns only. What makes no sense is taken as absent.
"""

from __future__ import annotations

import math
import re
import struct
from typing import Any

import numpy as np
from PIL import Image

MAKER_NOTE, LENS_MODEL, ELEVATION = 0x927C, 0xA434, 0x9405
APPLE, APPLE_HEADER = b"Apple iOS\0", 14  # bytes before the directory: the name, a version, the order of bytes
ACCELERATION, FRONT_CAMERA = 8, 0x45  # tags of Apple's
SIGNED_RATIONAL = 10
GRAVITY = (0.7, 1.3)  # of what is taken for it, in g: a phone that is not being shaken
DJI = re.compile(rb"drone-dji:Gimbal(Pitch|Roll)Degree[=>]\s*[\"']?\s*([+-]?\d+(?:\.\d+)?)")


def down_of(tags: dict[int, Any], xmp: Any, turn: Image.Transpose | None) -> np.ndarray | None:
    """Where down is, a unit vector [3] in the axes of the camera (OpenCV) whose picture is upright; or None.

    ``tags`` are those of EXIF; ``xmp`` are bytes, if there are any; ``turn`` makes the pixels of the file upright.
    """
    note = tags.get(MAKER_NOTE)
    if isinstance(note, bytes) and note.startswith(APPLE):
        down = _of_apple(note, str(tags.get(LENS_MODEL, "")))
        return None if down is None else _turned(down, turn)
    if isinstance(xmp, bytes) and (angles := dict(DJI.findall(xmp))).get(b"Pitch"):
        return _of_angles(float(angles[b"Pitch"]), float(angles.get(b"Roll", 0)))
    try:
        elevation = float(tags[ELEVATION])
    except (KeyError, TypeError, ValueError):
        return None
    return _of_angles(elevation, 0.0) if abs(elevation) <= 90 else None


def _turned(down: np.ndarray, turn: Image.Transpose | None) -> np.ndarray:
    """The vector [3] in the axes of the picture after a turn of its pixels, as Pillow does it."""
    x, y, z = down
    turned = {
        None: (x, y), Image.Transpose.FLIP_LEFT_RIGHT: (-x, y), Image.Transpose.FLIP_TOP_BOTTOM: (x, -y),
        Image.Transpose.ROTATE_90: (y, -x), Image.Transpose.ROTATE_180: (-x, -y), Image.Transpose.ROTATE_270: (-y, x),
        Image.Transpose.TRANSPOSE: (y, x), Image.Transpose.TRANSVERSE: (-y, -x),
    }[turn]  # fmt: skip
    return np.array([*turned, z])


def _of_apple(note: bytes, lens: str) -> np.ndarray | None:
    """Of the camera at the back, whose file has the right side of the phone at the top of its pixels.

    The acceleration of a phone at rest points down, along the axes of the phone: x to the right of its screen, y to its
    top, z out of it.
    """
    vector, front = None, "front" in lens.lower()
    try:
        order = {b"MM": ">", b"II": "<"}[note[APPLE_HEADER - 2 : APPLE_HEADER]]
        (n,) = struct.unpack_from(f"{order}H", note, APPLE_HEADER)
        for k in range(n):
            tag, kind, count, value = struct.unpack_from(f"{order}HHII", note, APPLE_HEADER + 2 + 12 * k)
            if tag == ACCELERATION and kind == SIGNED_RATIONAL and count == 3:
                parts = struct.unpack_from(f"{order}6i", note, value)
                vector = np.array([parts[i] / parts[i + 1] for i in (0, 2, 4)])
            front = front or (tag == FRONT_CAMERA and value == 1)
    except (KeyError, struct.error, ZeroDivisionError):
        return None
    if vector is None or front:
        return None
    x, y, z = vector
    length = math.hypot(x, y, z)
    return np.array([-y, -x, -z]) / length if GRAVITY[0] <= length <= GRAVITY[1] else None


def _of_angles(pitch: float, roll: float) -> np.ndarray:
    """Of a camera that looks so many degrees above the horizon, turned clockwise about its view by ``roll``."""
    pitch, roll = math.radians(pitch), math.radians(roll)
    level = math.cos(pitch)
    return np.array([level * math.sin(roll), level * math.cos(roll), -math.sin(pitch)])
