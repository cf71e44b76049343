"""A data set with other poses, as a folder that refers to the photographs where they lie.

``transforms.json`` in the layout of nerfstudio and instant-ngp, and ``points.ply``: every command takes the folder as
its data, and so do the trainers that read that layout. Lenses are those of the photographs, which are not copied.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.cameras import OPENCV_FROM_OPENGL
from ..support.errors import DataError
from ..support.files import replacing
from .colmap import find_model, image_folder, read_sources, split_views
from .dataset import Dataset
from .frame_cameras import FULL, intrinsics_of
from .point_ply import write_point_ply
from .transforms import NAME, RIG_FRAME, find_transforms, split_sources
from .view_images import ViewSource


def require_photographs(path: Path) -> None:
    """Raise ``DataError`` for data whose poses are exact by their making, those of a Mitsuba scene, and for a folder of
    smaller images alone, as refined poses are a data set of those at full size."""
    if path.suffix == ".xml":
        raise DataError(path, "the cameras of a scene are exact", "train without --refine-poses")
    model = find_model(path) if path.is_dir() else None
    if model and not (folder := image_folder(path, model)).is_dir():
        remedy = "put the images there, or train without --refine-poses"
        raise DataError(folder, "no such folder, and poses are refined by the images in it", remedy)


def write_refined(folder: Path, dataset: Dataset, data: Path, moved: Mapping[str, np.ndarray]) -> None:
    """Write the data set at ``data`` with other poses.

    Args:
        folder: to write.
        dataset: as it was read, for its points.
        data: a folder or file that ``load_dataset`` reads, with photographs.
        moved: world-to-camera matrices [4, 4] by the names of the views; others stay, all test views for instance.

    Raises ``DataError``.
    """
    sources, test = _sources(data)
    paths = {source.name: _path_from(folder, source.image_path) for source in sources}
    split = {
        "train_filenames": [paths[source.name] for source in sources if source.name not in test],
        "val_filenames": [paths[name] for name in test],
        "test_filenames": [paths[name] for name in test],
    }
    frames = []
    for source in sources:
        camera = replace(source.camera, w2c=moved.get(source.name, source.camera.w2c))
        pose = (camera.c2w @ OPENCV_FROM_OPENGL).tolist()
        rig = {} if source.rig_frame is None else {RIG_FRAME: source.rig_frame}
        known = {"file_path": paths[source.name], NAME: source.name, **rig, **_optics(source)}
        frames.append(known | {"transform_matrix": pose})
    write_point_ply(folder / "points.ply", dataset.points, dataset.point_colors)
    with replacing(folder / "transforms.json") as part:
        content = {"ply_file_path": "points.ply", **(split if test else {}), "frames": frames}
        part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _path_from(folder: Path, path: Path) -> str:
    """Of a file as seen from a folder; absolute where they lie on two drives.

    By where the folders really are: ``..`` of a link leads out of the folder that it links to. An image that is a link
    itself keeps its name.
    """
    path = path.parent.resolve() / path.name
    try:
        return os.path.relpath(path, folder.resolve()).replace(os.sep, "/")
    except ValueError:
        return path.as_posix()


def _sources(data: Path) -> tuple[list[ViewSource], list[str]]:
    """All views, and the names of those to test with."""
    model = find_model(data) if data.is_dir() else None
    if model:
        sources, _ = read_sources(model, image_folder(data, model))
        return sources, split_views(sources)[1]
    file = find_transforms(data) if data.is_dir() else data
    assert file is not None  # what was loaded
    sources, _, test = split_sources(file)
    return sources, test


def _optics(source: ViewSource) -> dict[str, Any]:
    """Intrinsics of a photograph as a frame has them."""
    lens = source.lens
    model = "OPENCV_FISHEYE" if lens.fisheye else "PINHOLE" if lens.straight else FULL if lens.divisor else "OPENCV"
    radial = {f"k{k}": value for k, value in enumerate((*lens.radial, *lens.divisor), 1)}
    tangential = {} if lens.fisheye else dict(zip(("p1", "p2"), lens.tangential, strict=True))
    distortion = {} if lens.straight else radial | tangential
    return {"camera_model": model, **intrinsics_of(source.camera), **distortion}
