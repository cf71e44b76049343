"""Data sets: COLMAP folders, ``transforms.json`` folders, Mitsuba scenes; one call reads each of them."""

from __future__ import annotations

from pathlib import Path

from ..support.arguments import checks_arguments
from ..support.errors import DataError
from .auto_exposure import auto_exposed
from .check import CameraCheck, check_cameras
from .dataset import Dataset, Observations, View, camera_extent
from .run_folders import refuse_run

__all__ = [
    "CameraCheck", "Dataset", "Observations", "View", "camera_extent", "check_cameras", "load_dataset", "load_largest",
]  # fmt: skip


def load_largest(path: str | Path, spp: int = 64) -> tuple[Dataset, int]:
    """A data set whose cameras are asked for: with the largest images that there are, none decoded before it is asked
    for, and their ``largest_images``. Raises ``DataError``."""
    from .colmap import largest_images  # here: as below

    factor = largest_images(Path(path))
    return load_dataset(path, factor, spp, on_disk=True), factor


@checks_arguments
def load_dataset(
    path: str | Path, downscale: int = 1, spp: int = 64, on_disk: bool = False, split: str = "test"
) -> Dataset:
    """Read the data set at ``path``, images averaged over ``downscale`` x ``downscale`` pixels.

    ``path`` is a folder with a COLMAP model (preferred where both exist), a folder with ``transforms.json``
    or ``transforms_train.json``, such a file itself, or a Mitsuba scene XML, whose sensors are rendered at
    ``spp`` samples. ``on_disk``: images are decoded whenever they are asked for. ``split``: "test", or "validation",
    which leaves the test views unread (``held_out``). OpenEXR images are linear radiance, and get the ``white`` of
    ``auto_exposed``. Raises ``DataError`` for anything that cannot be used; see ``check_cameras`` for the last test.
    """
    from .colmap import MODEL_FOLDERS, find_model, load_colmap  # here: photographs need the extra "train"
    from .mitsuba_scene import load_mitsuba_scene
    from .numbered_models import numbered_models
    from .transforms import find_transforms, load_transforms

    path = Path(path)
    if not path.exists():
        raise DataError(path, "no such file or folder", "check the path")
    if downscale < 1:
        raise DataError(path, f"downscale is {downscale}", "give a whole number of at least 1")
    if path.is_file() and path.suffix == ".xml":
        return load_mitsuba_scene(path, downscale, spp, split)
    if path.is_file() and path.suffix == ".json":
        return auto_exposed(load_transforms(path, downscale, on_disk, split))
    if path.is_dir() and find_model(path):
        return auto_exposed(load_colmap(path, downscale, on_disk, split))
    transforms = find_transforms(path) if path.is_dir() else None
    if transforms is None:
        refuse_run(path)
        if path.is_dir() and (models := numbered_models(path)):
            problem = f"has a COLMAP model in sparse/{models[0].name}, and none in sparse/0"
            raise DataError(path, problem, f"give {models[0]}")
        folders = ", ".join(MODEL_FOLDERS)
        raise DataError(
            path,
            f"not a known data set: no cameras and images (.bin or .txt) in {folders}, no transforms.json, "
            "no transforms_train.json",
            "give a folder with one of these (dogsplat poses makes it of plain images), or a Mitsuba scene as .xml",
        )
    return auto_exposed(load_transforms(transforms, downscale, on_disk, split))
