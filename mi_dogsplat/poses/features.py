"""SIFT features of all images (Lowe 2004), those under masks left out, and the cameras that the images share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..support.cores import usable_cores
from ..support.errors import DataError
from .colmap_database import IMAGE_BYTES, opened, require_room
from .config import PosesConfig
from .photographs import Photograph

GUESSED_FOCAL = 1.2  # longest sides, where nothing is known: COLMAP's
FISHEYE_FOCAL = 0.5  # the same of a fisheye: 115 degrees along the longer side, as action cameras have about
BATCH = 4  # images per core between two reports


def extract(
    pycolmap: Any,
    database: Path,
    folder: Path,
    masks: Mapping[str, Path],
    photographs: Sequence[Photograph],
    config: PosesConfig,
    progress: Callable[[int, int], None],
) -> None:
    """Fill the database with cameras, images and features; images that have features are left as they are.

    ``masks``: as of ``feature_masks``. Raises ``DataError`` for an image that pycolmap does not take, and for a disk
    that is full.
    """
    batch = BATCH * usable_cores()
    require_room(database, min(batch, len(photographs)) * IMAGE_BYTES)
    cameras = _cameras(pycolmap, database, photographs, config.camera_model)
    options = pycolmap.FeatureExtractionOptions(num_threads=usable_cores(), use_gpu=config.gpu)
    options.max_image_size = config.feature_size
    done = _names_with_features(pycolmap, database)
    progress(len(done), len(photographs))
    groups: dict[tuple[str, Path | None], list[str]] = {}  # pycolmap wants a mask for each image of a call, or none
    for p in photographs:
        if p.name not in done:
            groups.setdefault((p.camera, masks.get(p.name)), []).append(p.name)
    for (camera, masked), names in groups.items():
        reader = pycolmap.ImageReaderOptions(camera_model=config.camera_model, existing_camera_id=cameras[camera])
        if masked:
            reader.mask_path = str(masked)
        for at in range(0, len(names), batch):
            require_room(database, len(names[at : at + batch]) * IMAGE_BYTES)
            pycolmap.extract_features(
                str(database), str(folder), names[at : at + batch],
                reader_options=reader, extraction_options=options, device=device(pycolmap, config.gpu),
            )  # fmt: skip
            done |= set(names[at : at + batch])
            progress(len(done), len(photographs))
    if left_out := sorted(done - _names_with_features(pycolmap, database)):
        raise DataError(folder / left_out[0], "pycolmap finds no features in it", "look at the image, or remove it")


def _names_with_features(pycolmap: Any, database: Path) -> set[str]:
    with opened(pycolmap, database) as content:
        return {image.name for image in content.read_all_images() if content.exists_descriptors(image.image_id)}


def device(pycolmap: Any, gpu: bool) -> Any:
    """Where pycolmap is to compute."""
    return pycolmap.Device.cuda if gpu else pycolmap.Device.cpu


def _cameras(pycolmap: Any, database: Path, photographs: Sequence[Photograph], lens: str) -> dict[str, int]:
    """Ids of the cameras by their names, in the order in which the photographs name them; written if they are not."""
    groups: dict[str, list[Photograph]] = {}
    for photograph in photographs:
        groups.setdefault(photograph.camera, []).append(photograph)
    ids = {name: number for number, name in enumerate(groups, 1)}
    with opened(pycolmap, database) as content:
        for name, members in groups.items():
            if content.exists_camera(ids[name]):
                continue
            first = members[0]
            fisheye = "FISHEYE" in lens
            guess = (FISHEYE_FOCAL if fisheye else GUESSED_FOCAL) * max(first.width, first.height)
            focal = first.focal or guess
            camera = pycolmap.Camera.create_from_model_name(ids[name], lens, focal, first.width, first.height)
            # COLMAP drops all pairs of fisheyes without a prior, as no fundamental matrix tells their focal length
            camera.has_prior_focal_length = fisheye or first.focal is not None
            content.write_camera(camera, use_camera_id=True)
    return ids
