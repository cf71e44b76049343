"""COLMAP data sets: a model folder (``sparse/0``, ``sparse`` or the folder itself) and its ``images``.

With ``downscale=K`` a folder ``images_K`` that holds every image is used instead of averaging the full-size
ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress
from pathlib import Path

import numpy as np

from ..scene.cameras import Camera, inverse_rigid
from ..support.errors import DataError
from .check import require_plausible
from .colmap_files import read_cameras, read_frames, read_images, read_points
from .colmap_records import ColmapImage, ColmapPoints
from .dataset import Dataset, Observations, View, every_eighth, held_out, require_unique_names, view_name, views_named
from .image_files import image_files
from .images import is_file
from .lens import undistortion
from .point_colors import in_srgb
from .view_images import ViewSource, load_views, require_files, rig_frames

MODEL_FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", ".")


def find_model(path: Path) -> Path | None:
    """The first folder below ``path`` that holds a COLMAP model, or None."""
    return next(((path / folder).resolve() for folder in MODEL_FOLDERS if is_model(path / folder)), None)


def is_model(folder: Path) -> bool:
    """Whether a folder holds cameras and images of COLMAP."""
    return bool(model_file(folder, "cameras") and model_file(folder, "images"))


def load_colmap(path: Path, downscale: int, on_disk: bool = False, split: str = "test") -> Dataset:
    """Read a COLMAP data set; a missing ``points3D`` means no points. See ``split_views`` for ``split``.

    Raises ``DataError`` for anything missing, corrupt or inconsistent, and for cameras that do not see the
    points.
    """
    model = find_model(path)
    if model is None:
        raise DataError(path, "no COLMAP model here", "give the folder that holds sparse/0")
    folder = image_folder(path, model)
    sources, images = read_sources(model, folder)
    points = read_model_points(model)
    train, test = split_views(sources, split)
    wanted = {*train, *test}
    read = [source.name in wanted for source in sources]
    sources, images = list(compress(sources, read)), list(compress(images, read))
    smaller = folder.with_name(f"images_{downscale}")
    there = image_files(smaller, [image.name for image in images])
    relocated = [replace(source, image_path=file) for source, file in zip(sources, there, strict=True)]
    prescaled = downscale > 1 and all(is_file(source.image_path) for source in relocated)
    if not prescaled:
        if not folder.is_dir():
            factors = _smaller_ones(folder)
            problem = f"no such folder, only images_{factors[0]}"
            raise DataError(folder, problem, f"give --downscale {factors[0]}, or put the images at full size there")
        require_files([source.image_path for source in sources])
    views, has_alpha = load_views(relocated if prescaled else sources, downscale, prescaled, on_disk)
    observations = _observations(model, sources, images, views, points)
    train, test = views_named(views, train), views_named(views, test)
    colors = in_srgb(points.colors, [source.image_path for source in (relocated if prescaled else sources)])
    rig = rig_frames(sources)
    dataset = Dataset(folder.parent, train, test, points.positions, colors, has_alpha, observations, rig)
    require_plausible(
        dataset, "COLMAP's images file holds world-to-camera poses (quaternion w x y z, then translation)"
    )
    return dataset


def read_sources(model: Path, images_at: Path) -> tuple[list[ViewSource], list[ColmapImage]]:
    """Views of a model in the order of their image names, before images are read. Raises ``DataError``."""
    camera_file, image_file = model_file(model, "cameras"), model_file(model, "images")
    assert camera_file and image_file
    cameras = read_cameras(camera_file)
    images = sorted(read_images(image_file), key=lambda image: image.name)
    if not images:
        raise DataError(image_file, "the model has no registered image", "run COLMAP's mapper until images register")
    sources, frame_file = [], model_file(model, "frames")
    frames = read_frames(frame_file) if frame_file else {}
    files = image_files(images_at, [image.name for image in images])
    for image, file in zip(images, files, strict=True):
        if image.camera_id not in cameras:
            raise DataError(
                image_file,
                f'image "{image.name}" uses camera {image.camera_id}',
                f"add it to {camera_file.name}",
            )
        c = cameras[image.camera_id]
        camera = Camera(image.w2c, c.fx, c.fy, c.cx, c.cy, c.width, c.height)
        sources.append(ViewSource(view_name(image.name), file, camera, c.lens, frames.get(image.image_id)))
    require_unique_names(image_file, [source.name for source in sources])
    return sources, images


def split_views(sources: Sequence[ViewSource], split: str = "test") -> tuple[list[str], list[str]]:
    """Names of the views (to train on, to measure) by a split in ``SPLITS``. Every 8th of the ``sources``, which are
    sorted by the names of their images, is test; those of one frame of a rig count as one."""
    frames = rig_frames(sources)
    return held_out(*every_eighth([source.name for source in sources], frames), split, rig_frames=frames)


def read_poses(model: Path) -> dict[str, np.ndarray]:
    """Camera-to-world matrices [4, 4] of a model, by view name, whatever its lenses are. Raises ``DataError``."""
    file = model_file(model, "images")
    assert file
    return {view_name(image.name): inverse_rigid(image.w2c) for image in read_images(file)}


def read_model_points(model: Path) -> ColmapPoints:
    """Sparse points of a model; none where it has no ``points3D`` file. Raises ``DataError``."""
    file = model_file(model, "points3D")
    if file is None:
        return ColmapPoints(np.zeros(0, np.int64), np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32))
    return read_points(file)


def model_file(model: Path, stem: str) -> Path | None:
    """``stem.bin`` or else ``stem.txt`` in the model folder."""
    return next((file for suffix in (".bin", ".txt") if (file := model / (stem + suffix)).is_file()), None)


def image_folder(path: Path, model: Path) -> Path:
    """``images`` in the given folder, or above it where the model folder itself was given; it need not be there where
    smaller images are, in ``images_K``. Raises ``DataError``."""
    above = (path.resolve(), *path.resolve().parents[:2]) if model == path.resolve() else (path,)
    folders = [parent / "images" for parent in above]
    folder = next((folder for folder in folders if folder.is_dir()), None)
    folder = folder or next((folder for folder in folders if _smaller_ones(folder)), None)
    if folder is None:
        raise DataError(path / "images", "no such folder", "put the images of the COLMAP model there")
    return folder


def largest_images(path: Path) -> int:
    """By which factor the largest images of a data set are smaller than its cameras: above 1 where a folder with a
    COLMAP model has no ``images``, but smaller ones. Raises ``DataError``."""
    model = find_model(path) if path.is_dir() else None
    folder = image_folder(path, model) if model else path
    return 1 if folder.is_dir() or not model else _smaller_ones(folder)[0]


def _smaller_ones(folder: Path) -> list[int]:
    """By which factors there are folders of smaller images beside that of the images, in their order."""
    names = (path.name.removeprefix("images_") for path in folder.parent.glob("images_*") if path.is_dir())
    return sorted(int(name) for name in names if name.isdecimal())


def _observations(
    model: Path,
    sources: Sequence[ViewSource],
    images: list[ColmapImage],
    views: list[View],
    points: ColmapPoints,
) -> dict[str, Observations]:
    """What each view sees, in pixels of the (downscaled) view; images without observations are left out."""
    observations = {}
    if len(points.ids) == 0:
        return observations
    for source, image, view in zip(sources, images, views, strict=True):
        pixels, lens = image.pixels, source.lens
        if not lens.straight:
            pixels = undistortion(source.camera, lens).points(pixels)
        seen = (image.point_ids >= 0) & np.isfinite(pixels).all(axis=1)
        if not seen.any():
            continue
        rows = np.minimum(np.searchsorted(points.ids, image.point_ids[seen]), len(points.ids) - 1)  # [M]
        if (points.ids[rows] != image.point_ids[seen]).any():
            raise DataError(model, f'image "{image.name}" sees a point that points3D lacks', "export the model again")
        scale = (view.camera.fx / source.camera.fx, view.camera.fy / source.camera.fy)
        observations[source.name] = Observations(pixels[seen] * scale, rows)
    return observations
