"""Cameras of whatever is given: a COLMAP folder, ``transforms.json``, or a run folder, which names its data set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ..files.errors import FileError
from .camera import Camera
from .colmap import find_model, read_colmap
from .json_object import KINDS, read_json_object
from .transforms import read_transforms

NOTED = Path("checkpoint", "inputs.json")  # in a run folder: where its data set was
REFINED = Path("refined", "transforms.json")  # and the poses that it has found, where it was to refine them


def read_cameras(path: str | Path, size_of: Callable[[Path], tuple[int, int]]) -> tuple[list[Camera], int]:
    """(cameras sorted by name, the downscaling that a run folder was trained with, else 1). Raises ``FileError``.

    ``size_of`` tells the size of an image file, for data sets that do not say it.
    """
    path = Path(path)
    if not path.exists():
        raise FileError(path, "no such file or folder", "check the path")
    if path.name == "config.json" or (path.is_dir() and (path / "config.json").is_file()):
        return _cameras_of_run(path if path.is_file() else path / "config.json", size_of)
    if path.is_file() and path.suffix in (".bin", ".txt"):
        path = path.parent
    if path.is_dir() and (model := find_model(path)):
        cameras = read_colmap(path, model)
    else:
        names = ("transforms.json", "transforms_train.json", "transforms_test.json")
        files = [path] if path.is_file() else [path / name for name in names if (path / name).is_file()]
        if path.is_dir() and files and files[0].name == "transforms.json":
            files = files[:1]
        if not files:
            raise FileError(path, "no cameras found", KINDS)
        cameras = [camera for file in files for camera in read_transforms(file, size_of)]
    return sorted(cameras, key=lambda camera: camera.name), 1


def _cameras_of_run(config_file: Path, size_of: Callable[[Path], tuple[int, int]]) -> tuple[list[Camera], int]:
    """Those that a model was trained with: as the run has refined them, else as its data set has them."""
    config, run = read_json_object(config_file), config_file.parent
    remedy = "import the cameras from the data set itself"
    downscale = config.get("downscale", 1)
    if type(downscale) is not int or downscale < 1:
        raise FileError(config_file, 'its "downscale" is not a whole number above 0', remedy)
    places = _places(run, str(config["data"])) if "data" in config else []
    data = next((place for place in places if place.exists()), None)
    if (run / REFINED).is_file():
        cameras = read_cameras(run / REFINED, size_of)[0]
        return (cameras if data is None else _with_photographs(cameras, data, size_of)), downscale
    if not places:
        raise FileError(config_file, "does not name a data set", remedy)
    if data is None:
        raise FileError(config_file, 'its data set "{data}" is not there', remedy, data=config["data"])
    return read_cameras(data, size_of)[0], downscale


def _with_photographs(cameras: list[Camera], data: Path, size_of: Callable[[Path], tuple[int, int]]) -> list[Camera]:
    """Cameras with the photographs of a data set where they have lost their own: a run that was moved names them as
    seen from where it was."""
    if all(camera.image for camera in cameras):
        return cameras
    images = {camera.name: camera.image for camera in read_cameras(data, size_of)[0]}
    return [replace(camera, image=camera.image or images.get(camera.name)) for camera in cameras]


def _places(run: Path, data: str) -> list[Path]:
    """Where the data set of a run folder may be, the likeliest first.

    Its name may be relative to a folder that nobody knows any more, so the run notes where it was; both may have been
    moved since then.
    """
    try:
        noted = [Path(str(read_json_object(run / NOTED)["data"]))]
    except (FileError, KeyError):
        noted = []  # a run of before, or none of ours
    return [*noted, run / data, run.parent / data, Path(data)]
