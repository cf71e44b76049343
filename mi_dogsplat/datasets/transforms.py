"""``transforms.json`` (instant-ngp, nerfstudio) and ``transforms_train.json`` + ``_val`` + ``_test`` (NeRF synthetic).

Poses are camera-to-world in the OpenGL convention (x right, y up, z backward), or in Mitsuba's (x left, y up, z
forward) where a key of instant-ngp's tells them. Intrinsics may stand at the top or in each frame. Points come from
``ply_file_path``, which are in the frame of the poses, or from the COLMAP model beside the file of which it was made
(``colmap_beside.py``); else there are none.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..support.errors import DataError
from ..support.files import read_json
from .check import require_plausible
from .colmap import find_model
from .colmap_beside import points_beside
from .dataset import Dataset, every_eighth, held_out, require_unique_names, view_name, views_named
from .frame_cameras import camera_of, lens_of, merged, pose_of
from .images import is_file, named_file
from .named_like_images import folder_named_like
from .point_ply import read_point_ply
from .view_images import ViewSource, load_views, require_files, rig_frames

NAME = "view_name"  # ours: of a frame that is named otherwise than by its file, as where this lies elsewhere
RIG_FRAME = "rig_frame"  # ours: the same whole number in the frames that a rig took at one moment
MASK, DEPTH = "mask_path", "depth_file_path"  # nerfstudio's, of a frame
EXTENSIONS = ("", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".webp", ".exr")
CONVENTION = (
    "transform_matrix is camera-to-world with x right, y up, z backward (OpenGL), "
    "neither OpenCV's axes nor world-to-camera"
)

REPELLING = "dynamic_mask_"  # before the name of an image: instant-ngp's masks, white where nothing counts


def find_transforms(path: Path) -> Path | None:
    """``transforms.json``, or else ``transforms_train.json``, in the folder ``path``; None if it has
    neither."""
    return next(
        (f for name in ("transforms", "transforms_train") if (f := path / f"{name}.json").is_file()), None
    )


def load_transforms(file: Path, downscale: int, on_disk: bool = False, split: str = "test") -> Dataset:
    """Read the data set of a ``transforms*.json``. Raises ``DataError``.

    See ``split_sources`` for the split.
    """
    content = _parse(file)
    sources, train, test = split_sources(file, content, split)
    if not train:
        raise DataError(file, "no view is left for training", "name fewer images for tests and validation")
    views, has_alpha = load_views(sources, downscale, on_disk=on_disk)
    points, point_colors = _points(file, content, sources)
    train, test = views_named(views, train), views_named(views, test)
    rig = rig_frames(sources)
    dataset = Dataset(file.parent, train, test, points, point_colors, has_alpha, rig_frames=rig)
    require_plausible(dataset, CONVENTION)
    return dataset


def split_sources(
    file: Path, content: dict[str, Any] | None = None, split: str = "test"
) -> tuple[list[ViewSource], list[str], list[str]]:
    """Views of a ``transforms*.json`` before images are read, and names of those to train on and of those to measure.

    Test views are those of the ``_test`` file beside a ``_train`` one, or of ``test_filenames`` in the file; else those
    for validation, of the ``_val`` file or of ``val_filenames``; else every 8th image by sorted name. Where there are
    ``train_filenames``, no other image is trained on. With the ``split`` "validation" the views for validation are
    measured, where they are neither trained on nor test views; else see ``held_out``.

    ``content`` is what the file holds, if that is known. Raises ``DataError``.
    """
    content = _parse(file) if content is None else content
    sources = _sources(file, content)
    listed = {part: _named_in(file, content, sources, f"{part}_filenames") for part in ("train", "val", "test")}
    if of_test := _of_file(file, "test"):
        known, listed["test"] = {source.name for source in sources}, {source.name for source in of_test}
        if both := next((source.name for source in of_test if source.name in known), None):
            test_file = _file_of(file, "test")
            raise DataError(test_file, f'"{both}" is in {file.name} too', "remove it from one of the two")
    of_val: list[ViewSource] = []
    if split == "validation" or not listed["test"]:
        known = {source.name for source in sources + of_test}
        of_val = [source for source in _of_file(file, "val") if source.name not in known]  # some are copies of others
        listed["val"] |= {source.name for source in of_val}
    if of_test or of_val:
        sources += of_test + of_val
    else:
        sources.sort(key=lambda source: source.image_path)
    names, rig = [source.name for source in sources], rig_frames(sources)
    require_unique_names(file, names)
    if listed["train"] and listed["train"].isdisjoint(names):
        raise DataError(file, '"train_filenames" names none of its images', "correct it, or remove it")
    train = [name for name in names if name in listed["train"]] if listed["train"] else names
    part = "test" if listed["test"] else "val"
    test = [name for name in names if name in listed[part]]
    if listed[part]:
        train = [name for name in train if name not in listed[part]]
        if not test:
            raise DataError(file, f'"{part}_filenames" names none of its images', "correct it, or remove it")
    else:
        train, test = every_eighth(train, rig)
    own = [name for name in names if name in listed["val"] - listed["test"]] if part == "test" else []
    train, test = held_out(train, test, split, own, rig)
    wanted = {*train, *test}
    return [source for source in sources if source.name in wanted], train, test


def _file_of(file: Path, part: str) -> Path:
    return file.with_name(f"transforms_{part}.json")


def _of_file(file: Path, part: str) -> list[ViewSource]:
    """Views of another part beside a ``transforms_train.json``; none of other files."""
    beside = _file_of(file, part)
    return _sources(beside, _parse(beside)) if file.stem == "transforms_train" and beside.is_file() else []


def read_frame_positions(file: Path) -> np.ndarray:
    """Camera centres [V, 3] of the frames of a file whose poses are such. Raises ``DataError``."""
    poses = (frame.get("transform_matrix") for frame in _parse(file)["frames"] if isinstance(frame, dict))
    found = []
    for pose in poses:
        try:
            found.append(np.array(pose, np.float64)[:3, 3])
        except (ValueError, TypeError, IndexError):  # the reader tells
            continue
    return np.array(found).reshape(-1, 3)


def not_read(path: Path, masked: bool = False, with_depths: bool = False) -> list[str]:
    """What the frames of a data set say and no reader follows, in lines; nothing of other data sets.

    ``masked``, ``with_depths``: masks or depth maps are given, which take the place of those that frames name. Raises
    ``DataError``.
    """
    given = path if path.suffix == ".json" and path.is_file() else None
    file = find_transforms(path) if path.is_dir() and not find_model(path) else given
    if not file:
        return []
    frames = [frame for frame in _parse(file)["frames"] if isinstance(frame, dict)]
    lines = [] if masked else _unused(file, frames, MASK, "--masks", "masks")
    lines += [] if with_depths else _unused(file, frames, DEPTH, "--depths", "depth maps")
    if masked:
        return lines
    images = (_image_path(file.parent, str(frame.get("file_path", ""))) for frame in frames)
    if n := sum(is_file(image.with_name(f"{REPELLING}{image.stem}.png")) for image in images if image.name):
        like = "a folder with their negatives, named like the images"
        lines.append(f"the {REPELLING}*.png of {n} of its images, white where nothing counts; --masks takes {like}")
    return lines


def _unused(file: Path, frames: list[dict[str, Any]], key: str, flag: str, kind: str) -> list[str]:
    """A line on the files that frames name by a key, which a flag would use; none where no frame has one."""
    named = [frame for frame in frames if frame.get(key)]
    if not named:
        return []
    folder = folder_named_like(file.parent / str(named[0][key]).replace("\\", "/"), _view_name(named[0]))
    use = f"{flag} {folder} uses them" if folder else f"{flag} needs {kind} that are named like the images"
    return [f'the "{key}" of {len(named)} of its frames; {use}']


def _parse(file: Path) -> dict[str, Any]:
    """The JSON object of a file with at least one frame. Raises ``DataError`` with the line of a syntax
    error."""
    content = read_json(file, "correct that line")
    if not isinstance(content, dict) or not isinstance(content.get("frames"), list) or not content["frames"]:
        raise DataError(file, 'has no cameras ("frames" is absent or empty)', "add a frame per image")
    return content


def _sources(file: Path, content: dict[str, Any]) -> list[ViewSource]:
    shared = {key: value for key, value in content.items() if key != "frames"}
    frames = content["frames"]
    for i, frame in enumerate(frames):
        if not isinstance(frame, dict) or None in (frame.get("file_path"), frame.get("transform_matrix")):
            raise DataError(
                file, f'frame {i} lacks "file_path" or "transform_matrix"', "add both to each frame"
            )
    paths = [_image_path(file.parent, str(frame["file_path"])) for frame in frames]
    require_files(paths)
    sources = []
    for frame, image_path in zip(frames, paths, strict=True):
        name, said = str(frame["file_path"]), merged(shared, frame)
        remedy = f"correct it ({CONVENTION})"
        try:
            w2c = pose_of(said)
            remedy = "correct it, or leave it out"
            camera, lens = camera_of(file, said, w2c, image_path), lens_of(file, said)
        except (ValueError, TypeError, ArithmeticError) as error:
            if isinstance(error, DataError):
                raise
            raise DataError(file, f'frame "{name}": {error}', remedy) from error
        sources.append(ViewSource(_view_name(frame), image_path, camera, lens, _rig_frame(file, frame)))
    return sources


def _rig_frame(file: Path, frame: dict[str, Any]) -> int | None:
    number = frame.get(RIG_FRAME)
    if number is not None and (isinstance(number, bool) or not isinstance(number, int)):
        name = frame["file_path"]
        raise DataError(file, f'frame "{name}": "{RIG_FRAME}" is {json.dumps(number)}', "make it a whole number")
    return number


def _view_name(frame: dict[str, Any]) -> str:
    return view_name(str(frame.get(NAME) or frame.get("file_path", "")))


def _image_path(folder: Path, name: str) -> Path:
    """The image that ``file_path`` names, which may omit the extension; the name as given if there is
    none."""
    path = Path(name.replace("\\", "/"))
    named = [path.name + extension for extension in EXTENSIONS]
    if exact := next((file for one in named if is_file(file := folder / path.parent / one)), None):
        return exact
    return next((file for one in named if is_file(file := named_file(folder, path.parent / one))), folder / path)


def _named_in(file: Path, content: dict[str, Any], sources: list[ViewSource], key: str) -> set[str]:
    """What ``test_filenames`` or another such list names, as views where it finds some: by ``file_path``, or another
    path to the image."""
    named = content.get(key, [])
    if not isinstance(named, list):
        raise DataError(file, f'"{key}" is not a list', "make it a list of image names, or remove it")
    called = {view_name(str(f["file_path"])): s.name for f, s in zip(content["frames"], sources, strict=True)}
    places = {source.image_path.resolve(): source.name for source in sources} if named else {}
    found: set[str] = set()
    for name in map(str, named):
        path = _image_path(file.parent, name)
        place = places.get(path.resolve()) if is_file(path) else None
        found.add(called.get(view_name(name)) or place or view_name(name))
    return found


def _points(file: Path, content: dict[str, Any], sources: list[ViewSource]) -> tuple[np.ndarray, np.ndarray]:
    """Points [P, 3] and colours [P, 3] in the frame of the poses; see the module docstring for where from."""
    if content.get("ply_file_path"):
        return read_point_ply(file.parent / str(content["ply_file_path"]).replace("\\", "/"))
    return points_beside(file.parent, sources)
