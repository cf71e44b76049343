"""Record3D's export "EXR + JPG": a folder with ``rgb/*.jpg``, ``depth/*.exr`` in metres and ``metadata.json``.

``poses`` has a row ``qx qy qz qw x y z`` for each frame: camera-to-world, OpenGL, in the axes of the first one, so that
nothing tells where up is. ``K`` is the matrix of intrinsics, column by column, or ``perFrameIntrinsicCoeffs`` has ``fx
fy cx cy`` for each frame, both for images of ``w`` by ``h`` pixels; the JPEG files may be larger. Source: the author of
the app in issues 27, 31, 33, 36 and 67 of github.com/marek-simonik/record3d. In its own format, ``.r3d``, depth is
packed by LZFSE, for which there is no kept library for Python.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...scene.cameras import opengl_c2w_to_opencv_w2c
from ...support.errors import DataError
from ...support.files import read_object
from .scan import REMEDY, Scan, ScanFrame, existing, pose_of, require_frames

APP = "Record3D"
METADATA = "metadata.json"
PACKED = ".r3d"
EXPORT = "export the recording as EXR + JPG in Record3D, and give that folder"


def find(path: Path) -> Path | None:
    """The folder of the export, which may be one below; None if ``path`` is no such scan.

    Raises ``DataError`` for what has been unpacked from Record3D's own format.
    """
    if (path / "metadata").is_file() and (path / "rgbd").is_dir():
        raise DataError(path, f"is an unpacked {PACKED}, whose depth maps cannot be read here", EXPORT)
    folders = (path, path / "EXR_RGBD")
    return next((one for one in folders if (one / METADATA).is_file() and (one / "rgb").is_dir()), None)


def read(folder: Path) -> Scan:
    """The scan of an export, of frames that have an image. Raises ``DataError``."""
    file = folder / METADATA
    told = read_object(file, REMEDY)
    try:
        poses = np.array(told["poses"], np.float64)
        if poses.ndim != 2 or poses.shape[1] != 7:
            raise ValueError(f'"poses" has shape {poses.shape}, expected (frames, 7)')
        frames = [_frame(folder, told, number, pose) for number, pose in enumerate(poses)]
    except KeyError as error:
        raise DataError(file, f"lacks {error}", f"{EXPORT}; only recordings by LiDAR have poses") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(file, f"has no cameras that can be used ({error})", REMEDY) from None
    found = [frame for frame in frames if frame.image]
    require_frames(folder, found)
    return Scan(APP, found, None)


def _frame(folder: Path, told: dict[str, Any], number: int, pose: np.ndarray) -> ScanFrame:
    frame = ScanFrame(
        number,
        opengl_c2w_to_opencv_w2c(pose_of(pose[:4], pose[4:])),
        _intrinsics(told, number),
        (int(told["w"]), int(told["h"])),
        existing(folder / "rgb" / f"{number}.jpg"),
        existing(folder / "depth" / f"{number}.exr"),
    )
    frame.camera(*frame.size or (1, 1))
    return frame


def _intrinsics(told: dict[str, Any], number: int) -> tuple[float, float, float, float]:
    own = told.get("perFrameIntrinsicCoeffs")
    if own and number < len(own):
        fx, fy, cx, cy = map(float, own[number][:4])
        return fx, fy, cx, cy
    fx, _, _, _, fy, _, cx, cy, _ = map(float, told["K"])
    return fx, fy, cx, cy
