"""Cameras of whatever is given: a COLMAP folder, ``transforms.json``, or a run folder, which names its data set."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..files.errors import FileError
from .camera import Camera
from .colmap import find_model, read_colmap
from .json_object import KINDS, read_json_object
from .transforms import read_transforms

NOTED = Path("checkpoint", "inputs.json")  # in a run folder: where its data set was


def read_cameras(path: str | Path, size_of: Callable[[Path], tuple[int, int]]) -> tuple[list[Camera], int]:
    """(cameras sorted by name, the downscaling that a run folder was trained with, else 1). Raises ``FileError``.

    ``size_of`` tells the size of an image file, for data sets that do not say it.
    """
    path = Path(path)
    if not path.exists():
        raise FileError(path, "no such file or folder", "check the path")
    if path.name == "config.json" or (path.is_dir() and (path / "config.json").is_file()):
        config_file = path if path.is_file() else path / "config.json"
        config = read_json_object(config_file)
        remedy = "import the cameras from the data set itself"
        if "data" not in config:
            raise FileError(config_file, "does not name a data set", remedy)
        data = next((place for place in _places(config_file.parent, str(config["data"])) if place.exists()), None)
        if data is None:
            raise FileError(config_file, 'its data set "{data}" is not there', remedy, data=config["data"])
        downscale = config.get("downscale", 1)
        if type(downscale) is not int or downscale < 1:
            raise FileError(config_file, 'its "downscale" is no whole number above 0', remedy)
        return read_cameras(data, size_of)[0], downscale
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
