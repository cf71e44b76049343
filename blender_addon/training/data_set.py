"""The folder that ``dogsplat train`` reads: pictures, exact poses, points; it is no data set before it is complete.

``views.json`` holds which views are rendered, with which camera and settings, so that an interrupted rendering goes on.
``transforms.json`` is written last. The next rendering begins anew.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..cameras.camera import OPENCV_FROM_OPENGL, Camera
from ..files.errors import FileError
from ..files.whole import remove, write_whole
from .rig import held_out

RECORD, TRANSFORMS, POINTS, IMAGES = "views.json", "transforms.json", "points.ply", "images"
ELSEWHERE = "choose another folder for the training"
Frame = dict[str, Any]  # of transforms.json


class DataSet:
    """A folder that is being filled."""

    def __init__(self, folder: Path, settings: dict[str, Any], suffix: str):
        """``settings``: those on which the pictures depend. Raises ``FileError`` for a folder of something else."""
        self.folder, self._settings, self._suffix = folder, settings, suffix
        try:
            if folder.is_dir() and any(folder.iterdir()) and not (folder / RECORD).is_file():
                raise FileError(folder, "is a folder with other contents", ELSEWHERE)
            (folder / IMAGES).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(folder, "cannot be written ({reason})", ELSEWHERE, reason=error.strerror) from error
        self._frames = {} if is_complete(folder) else self._recorded()
        self._write_record()
        remove(folder / TRANSFORMS)

    def frame(self, camera: Camera) -> Frame:
        """A camera as ``transforms.json`` has it."""
        name = re.sub(r"[^\w.-]", "_", camera.name)
        intrinsics = {"w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy}
        pose = np.linalg.inv(camera.w2c) @ OPENCV_FROM_OPENGL
        file = f"{IMAGES}/{name}{self._suffix}"
        return {"file_path": file, **intrinsics, "cx": camera.cx, "cy": camera.cy, "transform_matrix": pose.tolist()}

    def has(self, frame: Frame) -> bool:
        """Whether this view, by this camera, is rendered."""
        return self._frames.get(frame["file_path"]) == frame and self.path(frame).is_file()

    def path(self, frame: Frame) -> Path:
        """Of its picture."""
        return self.folder / frame["file_path"]

    def keep(self, frame: Frame) -> None:
        """Its picture is there. Raises ``FileError`` if it is not."""
        if not self.path(frame).is_file():
            raise FileError(self.path(frame), "was not rendered", "look for the reason in Blender's console")
        self._frames[frame["file_path"]] = frame
        self._write_record()

    def complete(self, frames: Sequence[Frame], points: tuple[np.ndarray, np.ndarray], unit: float) -> None:
        """Write what makes a data set of it; ``points``: positions [P, 3] and colours [P, 3]; ``unit`` in metres."""
        for stale in self._frames.keys() - {frame["file_path"] for frame in frames}:
            remove(self.folder / stale)
        content: dict[str, Any] = {"camera_model": "PINHOLE"}
        if len(points[0]):
            write_points(self.folder / POINTS, *points)
            content["ply_file_path"] = POINTS
        tests = held_out(len(frames))
        train = [frame["file_path"] for i, frame in enumerate(frames) if i not in tests]
        test = [frame["file_path"] for i, frame in enumerate(frames) if i in tests]
        if test:
            content |= {"train_filenames": train, "val_filenames": test, "test_filenames": test}
        self._write("world.json", {"up": "z", "scale": unit})
        self._write(TRANSFORMS, {**content, "frames": list(frames)})

    def _recorded(self) -> dict[str, Frame]:
        """What an interrupted rendering has, if it was of the same settings."""
        try:
            content = json.loads((self.folder / RECORD).read_text(encoding="utf-8"))
            frames = content["frames"] if content["settings"] == self._settings else {}
        except (OSError, ValueError, KeyError, TypeError):
            return {}
        return frames

    def _write_record(self) -> None:
        self._write(RECORD, {"settings": self._settings, "frames": self._frames})

    def _write(self, name: str, content: dict[str, Any]) -> None:
        write_whole(self.folder / name, [(json.dumps(content, indent=1) + "\n").encode()])


def is_complete(folder: Path) -> bool:
    """Whether a training can begin."""
    return (folder / TRANSFORMS).is_file()


def is_begun(folder: Path) -> bool:
    """Whether a rendering was interrupted there."""
    return (folder / RECORD).is_file() and not is_complete(folder)


def write_points(path: Path, points: np.ndarray, colors: np.ndarray) -> None:
    """Points [P, 3] with sRGB colours [P, 3] in 0..1 as a PLY. Raises ``FileError``."""
    rows = np.empty(len(points), [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    rows["xyz"], rows["rgb"] = points, np.round(np.clip(colors, 0, 1) * 255)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    write_whole(path, ["\n".join([*header, "end_header\n"]).encode(), rows.tobytes()])
