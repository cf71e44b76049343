"""SIFT features of all images (Lowe 2004), those under masks left out, and the cameras that the images share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..support.cores import usable_cores
from .colmap_database import opened
from .config import PosesConfig
from .photographs import Photograph

GUESSED_FOCAL = 1.2  # longest sides, where nothing is known: COLMAP's
BATCH = 4  # images per core between two reports


def extract(
    pycolmap: Any,
    database: Path,
    folder: Path,
    masks: Path | None,
    photographs: Sequence[Photograph],
    config: PosesConfig,
    progress: Callable[[int, int], None],
) -> None:
    """Fill the database with cameras, images and features; images that have features are left as they are."""
    cameras = _cameras(pycolmap, database, photographs, config.lens)
    with opened(pycolmap, database) as content:
        done = {image.name for image in content.read_all_images() if content.exists_descriptors(image.image_id)}
    options = pycolmap.FeatureExtractionOptions(num_threads=usable_cores(), use_gpu=config.gpu)
    options.max_image_size = config.feature_size
    reader = pycolmap.ImageReaderOptions(camera_model=config.lens)
    if masks:
        reader.mask_path = str(masks)
    progress(len(done), len(photographs))
    for name, camera in cameras.items():
        missing = [p.name for p in photographs if p.camera == name and p.name not in done]
        reader.existing_camera_id = camera
        batch = BATCH * usable_cores()
        for at in range(0, len(missing), batch):
            pycolmap.extract_features(
                str(database), str(folder), missing[at : at + batch],
                reader_options=reader, extraction_options=options, device=device(pycolmap, config.gpu),
            )  # fmt: skip
            done |= set(missing[at : at + batch])
            progress(len(done), len(photographs))


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
            focal = first.focal or GUESSED_FOCAL * max(first.width, first.height)
            camera = pycolmap.Camera.create_from_model_name(ids[name], lens, focal, first.width, first.height)
            camera.has_prior_focal_length = first.focal is not None
            content.write_camera(camera, use_camera_id=True)
    return ids
