"""The model as a COLMAP folder, with the lens of the photographs or without; it appears whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets.colmap import read_sources
from ..datasets.exr import is_exr
from ..datasets.images import read_image, saturation
from ..datasets.lens import Undistortion, undistortion
from ..datasets.masks import mask_files
from ..datasets.named_like_images import composed
from ..datasets.point_colors import in_srgb
from ..support.errors import DataError
from .colmap_database import require_room
from .resampled import write_resampled

PART = "sparse.part"
VIEW_BYTES = 1024  # of an image in all files: its name, pose, camera, rig and frame, at most
FEATURE_BYTES, POINT_BYTES, SEEN_BYTES = 24, 51, 8  # of a feature in an image, of a point, of each image that sees it


def write_model(model: Any, target: Path) -> None:
    """Write ``cameras.bin``, ``images.bin`` and ``points3D.bin`` (and COLMAP's ``rigs``, ``frames``) as ``target``.

    Raises ``DataError`` where they have no room.
    """
    require_room(target.parent, _n_bytes(model))
    with appearing(target) as folder:
        model.write_binary(str(folder))


@contextmanager
def appearing(target: Path) -> Iterator[Path]:
    """A folder to write a model into, which becomes ``target``, in a folder of its own, at the end of the block."""
    top = target.parent.with_name(PART)
    shutil.rmtree(top, ignore_errors=True)
    (top / target.name).mkdir(parents=True)
    yield top / target.name
    os.replace(top, target.parent)


def renamed(model: Any, rename: Callable[[str], str]) -> Any:
    """The model of pycolmap's, whose images have other names from now on."""
    for image in model.images.values():
        image.name = rename(image.name)
    return model


def _n_bytes(model: Any) -> int:
    """Of the files of a model, at most."""
    features = sum(image.num_points2D() for image in model.images.values())
    of_points = POINT_BYTES * model.num_points3D() + SEEN_BYTES * model.compute_num_observations()
    return VIEW_BYTES * model.num_images() + FEATURE_BYTES * features + of_points


def undistort(pycolmap: Any, distorted: Path, out: Path, progress: Callable[[int, int], None]) -> Any:
    """Write the images of the COLMAP folder ``distorted`` as those of a pinhole, and its masks; the model of these.

    Images are resampled as by the readers of our data sets (``lens.py``). Raises ``DataError``.
    """
    model = distorted / "sparse" / "0"
    sources, images = read_sources(model, distorted / "images")
    straight, masks = {}, mask_files(distorted / "masks")  # which have the names of what a screen shows of OpenEXR
    for number, (source, image) in enumerate(zip(sources, images, strict=True), 1):
        try:
            straight[image.name] = undistortion(source.camera, source.lens)
        except ValueError as error:
            raise DataError(source.image_path, str(error), "use another --lens") from error
        _resample(source.image_path, out / "images" / image.name, straight[image.name])
        if mask := masks.get(composed(source.name)):
            _resample(mask, out / mask.relative_to(distorted), straight[image.name])
        progress(number, len(sources))
    made = _pinhole(pycolmap, pycolmap.Reconstruction(str(model)), straight)
    points = list(made.points3D.values())
    raw = np.array([point.color for point in points], np.float32).reshape(-1, 3) / 255
    colors = in_srgb(raw, [source.image_path for source in sources])  # which the new images have
    for point, color in zip(points, np.rint(255 * colors).astype(np.uint8), strict=True):
        point.color = color
    return made


def _resample(source: Path, target: Path, how: Undistortion) -> None:
    if target.is_file():
        return
    write_resampled(how.image(read_image(source), unlimited=is_exr(source)), target, saturation(source))


def _pinhole(pycolmap: Any, model: Any, straight: dict[str, Undistortion]) -> Any:
    """The model with pinhole cameras, and its observations where these see them."""
    for image in model.images.values():
        pixels = straight[image.name].points(np.array([point.xy for point in image.points2D]).reshape(-1, 2))
        for point, xy in zip(image.points2D, pixels, strict=True):
            point.xy = xy
    of_camera = {image.camera_id: straight[image.name] for image in model.images.values()}
    for camera_id, how in of_camera.items():
        camera, c = model.cameras[camera_id], how.camera
        camera.model, camera.width, camera.height = pycolmap.CameraModelId.PINHOLE, c.width, c.height
        camera.params = [c.fx, c.fy, c.cx, c.cy]
    return model
