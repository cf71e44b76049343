"""What poses are sought of: a folder of photographs, a video, or a scan, which has some; told apart by names alone."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path

from ..datasets import exr, heif
from ..datasets.colmap import find_model
from ..datasets.numbered_models import numbered_models
from ..datasets.photograph_names import NEWER, PHOTOGRAPHS, PLAIN, RAW
from ..datasets.run_folders import refuse_run
from ..datasets.scans import record3d
from ..datasets.scans.apps import is_scan
from ..datasets.transforms import find_transforms
from ..support.errors import DataError
from ..support.run_files import are_of_run
from ..support.wording import counted
from . import raw_files
from .config import SETTINGS

VIDEOS = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mts", ".m2ts", ".3gp", ".mpg", ".mpeg")
MASKS = "masks"  # the name of their folder
FEWEST = 2
CAPTURE = "capture.json"
OURS = {SETTINGS, CAPTURE, "film.json"}  # each in a folder that was made here; a run is told by ``are_of_run``


def is_video(path: Path) -> bool:
    """A file that is called like a video."""
    return path.suffix.lower() in VIDEOS and path.is_file()


def needs_poses(path: str | Path) -> bool:
    """Whether a path is a video, a scan, or a folder of images without any cameras that a reader would find, or
    name."""
    path = Path(path)
    if not path.is_dir():
        return is_video(path)
    if has_cameras(path):
        return False
    return is_scan(path) or _is_result(path) or bool(_files(path, PHOTOGRAPHS))  # of a result ``require_input`` tells


def find_photographs(folder: Path, out: Path, masks: Path | None = None, linear: bool = False) -> dict[str, Path]:
    """Images of a folder and of those below it, by their names in there, sorted.

    Either all of them are images of linear light (``light.is_light``), or none is. Where there are others beside them,
    raw photographs and OpenEXR are taken if ``linear`` asks for it. What a camera wrote in several formats counts once:
    HEIC beside a JPEG of its name, and raw photographs beside either.

    Left out: what lies in ``out``, in results of other commands (``_made_here``), in ``masks`` and in folders of
    that name, in hidden ones; and all but ``images`` where there is such a folder, as others beside it hold smaller
    copies. Raises ``DataError`` where there are fewer than two, and for images that cannot be taken: leaving out a part
    of a capture would not be noticed.
    """
    top = folder / "images" if (folder / "images").is_dir() else folder
    without = {path.resolve() for path in (out, masks) if path is not None}
    kinds = PLAIN, heif.SUFFIXES, NEWER, RAW, (exr.SUFFIX,)
    shown, of_phones, newer, raw, light = (_files(top, suffixes, without) for suffixes in kinds)
    shown = sorted(shown + _others(of_phones, shown))
    found = (raw or light) if linear else (shown or raw or light)
    if linear and shown and not found:
        raise DataError(top, "has no raw photographs and no OpenEXR, whose light --linear keeps", "leave it out")
    if unfit := [path for files in ((shown, newer) if linear else (newer, raw)) for path in _others(files, found)]:
        raise _unfit(unfit, len(found), linear)
    if len(found) < FEWEST:
        raise _too_few(top, found, _beside(folder))
    return {path.relative_to(top).as_posix(): path for path in found}


def _too_few(top: Path, found: list[Path], beside: list[Path]) -> DataError:
    """Where there is no image, or a single one; ``beside``: those that are not taken."""
    videos = _files(top, VIDEOS)
    remedy = f"name the video itself: {videos[0]}" if videos else "give at least two that overlap, better 20 to 200"
    remedy = f"move the {counted(len(beside), 'image')} beside it into it, or rename it" if beside else remedy
    n = "no image" if not found else "a single image"
    return DataError(top, f"has {n}, and depth needs several", remedy)


def _unfit(files: list[Path], n_found: int, linear: bool) -> DataError:
    """Images that cannot be taken beside ``n_found`` others."""
    part = f"{len(files)} of {len(files) + n_found} are such"
    if linear:
        return DataError(files[0], f"holds no linear light ({part})", "leave out --linear, or remove such images")
    if raw_files.is_raw(files[0]):
        remedy = "export them as JPEG like the others, or give only raw photographs"
        return DataError(files[0], f"is raw, and others are not ({part})", remedy)
    kind = files[0].suffix[1:].upper()
    remedy = "export them as JPEG or PNG, in the size in which they were taken"
    return DataError(files[0], f"{kind} images cannot be read here ({part})", remedy)


def _others(files: list[Path], found: list[Path]) -> list[Path]:
    """Files of pictures that are not among those ``found``: a camera may write one picture in two formats."""
    stems = {path.with_suffix("") for path in found}
    return [path for path in files if path.with_suffix("") not in stems]


def not_taken(source: Path, masks: Path | None = None) -> list[str]:
    """Photographs that ``find_photographs`` leaves out though they are neither copies nor masks, in a line."""
    beside = _beside(source)
    if not beside or (masks is not None and masks.resolve() == source.resolve()):
        return []
    only = f"only images in {source / 'images'} are used; move them into it, or rename it"
    return [f"{counted(len(beside), 'image')} of this folder, such as {beside[0].name}: {only}"]


def _beside(folder: Path) -> list[Path]:
    """Images that lie in a folder itself, beside the one called ``images``, of which those are taken."""
    if not (folder / "images").is_dir():
        return []
    return sorted(p for p in folder.iterdir() if p.suffix.lower() in PHOTOGRAPHS and p.name[0] != "." and p.is_file())


def mask_folder(source: Path, given: str | None) -> Path | None:
    """The folder of masks that was given, or the one beside the images, in any case, as Windows and macOS have it;
    None without one. Raises ``DataError``."""
    if given is None:
        beside = [p for p in source.iterdir() if p.name.lower() == MASKS and p.is_dir()] if source.is_dir() else []
        return max(beside, default=None)  # the usual spelling, where there are several
    if not Path(given).is_dir():
        raise DataError(given, "no such folder", "give a folder with a mask per image")
    return Path(given)


def require_input(path: Path) -> None:
    """Raise ``DataError`` for what is neither a folder of photographs nor a video.

    Such is a run: its pictures are renders. And so is a folder in which poses are still looked for, as not all
    photographs may have been copied into it, a capture of a scene that was stopped, which gets its cameras at its end,
    and one all of whose photographs lie in data sets.
    """
    if not path.exists():
        raise DataError(path, "no such file or folder", "check the path")
    if path.is_dir():
        if _is_result(path):
            if (path / SETTINGS).is_file():
                problem = "has no poses yet: the search for them was stopped, or found none"
                raise DataError(path, problem, "give the photographs that it was made of, or a data set with poses")
            if (path / CAPTURE).is_file():
                problem = "is a capture of a scene that was stopped, whose cameras are written at its end"
                raise DataError(path, problem, "let it end: the same dogsplat capture command continues")
            refuse_run(path)
        if not has_cameras(path) and (inner := _data_sets_in(path)):
            problem = "has no cameras itself, and all of its images lie in folders that have some"
            raise DataError(path, problem, f"give {'one of these, such as ' * (len(inner) > 1)}{inner[0]}")
        return
    if path.suffix.lower() == record3d.PACKED:
        raise DataError(path, "is in Record3D's own format, which is not read here", record3d.EXPORT)
    if path.suffix.lower() == ".zip":
        raise DataError(path, "is an archive", "unpack it, and give the folder")
    if not is_video(path):
        one = "a single image" if path.suffix.lower() in PLAIN else "neither a folder of images nor a video"
        raise DataError(path, f"is {one}", f"give a folder of images, or a video ({', '.join(VIDEOS[:5])})")


def has_cameras(folder: Path) -> bool:
    """Whether a reader of data sets would find some, or name the model that has them."""
    return bool(find_model(folder) or find_transforms(folder) or numbered_models(folder))


def _data_sets_in(top: Path) -> list[Path]:
    """The data sets below a folder, sorted; none where any photograph lies outside of them."""
    inner = set()
    for folder in {file.parent for file in _files(top, PHOTOGRAPHS)}:
        below = [folder, *folder.parents][: len(folder.relative_to(top).parts)]
        if not (found := next(filter(has_cameras, below), None)):
            return []
        inner.add(found)
    return sorted(inner)


def _files(top: Path, suffixes: tuple[str, ...], without: Collection[Path] = ()) -> list[Path]:
    """Files with one of the suffixes, of whatever case, sorted; none of folders called ``MASKS``, of hidden ones, of
    folders that were made here, nor of those ``without``, paths without links."""
    found = []
    for folder, names, files in os.walk(top):
        names[:] = [name for name in names if name.lower() != MASKS and name[0] != "."]
        if Path(folder) != top and (Path(folder).resolve() in without or _made_here(files)):
            names.clear()
            continue
        found += [Path(folder, file) for file in files if Path(file).suffix.lower() in suffixes and file[0] != "."]
    return sorted(found)


def _is_result(folder: Path) -> bool:
    """Whether a folder is a run, or what a search for poses or a capture has left that was stopped."""
    files = os.listdir(folder)
    stopped = (SETTINGS in files and not find_model(folder)) or (CAPTURE in files and not has_cameras(folder))
    return are_of_run(files) or stopped


def _made_here(files: list[str]) -> bool:
    """Whether a folder of these files is a result: of poses, a capture, a film, or a run."""
    return are_of_run(files) or not OURS.isdisjoint(files)
