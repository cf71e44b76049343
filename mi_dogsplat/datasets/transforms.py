"""``transforms.json`` (instant-ngp, nerfstudio) and ``transforms_train.json`` + ``_test`` (NeRF synthetic).

Poses are camera-to-world in the OpenGL convention (x right, y up, z backward), or in Mitsuba's (x left, y up, z
forward) where a key of instant-ngp's tells them. Intrinsics may stand at the top or in each frame. Points come from
``ply_file_path``, or from a COLMAP model beside the file if its cameras stand at the same places (instant-ngp's
converter moves and scales the scene, and then they do not); else there are none.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..support.errors import DataError
from ..support.files import read_json
from .check import require_plausible
from .colmap import find_model, read_model_points, read_positions
from .dataset import Dataset, every_eighth, held_out, no_points, require_unique_names, view_name, views_named
from .frame_cameras import camera_of, lens_of, merged
from .images import is_file, named_file
from .point_colors import in_srgb
from .point_ply import read_point_ply
from .view_images import ViewSource, load_views, require_files

NAME = "view_name"  # ours: of a frame that is named otherwise than by its file, as where this lies elsewhere
MASK = "mask_path"  # nerfstudio's, of a frame
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

    The split is that of the ``_train`` and ``_test`` files, or of ``test_filenames`` in the file, or, where that names
    nothing, of its ``val_filenames``; else every 8th image by sorted name is test. Where there are ``train_filenames``,
    no other image is trained on. See ``held_out`` for ``split``.
    """
    content = _parse(file)
    sources, train, test = split_sources(file, content)
    if not train:
        raise DataError(file, "no view is left for training", "name fewer test images")
    train, test = held_out(train, test, split)
    wanted = {*train, *test}
    read = [source for source in sources if source.name in wanted]
    views, has_alpha = load_views(read, downscale, on_disk=on_disk)
    points, point_colors = _points(file, content, sources, [source.image_path for source in read])
    train, test = views_named(views, train), views_named(views, test)
    dataset = Dataset(file.parent, train, test, points, point_colors, has_alpha)
    require_plausible(dataset, CONVENTION)
    return dataset


def split_sources(
    file: Path, content: dict[str, Any] | None = None
) -> tuple[list[ViewSource], list[str], list[str]]:
    """Views of a ``transforms*.json`` before images are read, and names of those to train on and to test with.

    ``content`` is what the file holds, if that is known. Raises ``DataError``.
    """
    content = _parse(file) if content is None else content
    sources = _sources(file, content)
    test_file = file.with_name("transforms_test.json")
    train_names = _named_in(file, content, sources, "train_filenames")
    test_key = "test_filenames" if content.get("test_filenames") else "val_filenames"
    test_names = _named_in(file, content, sources, test_key)
    if file.stem == "transforms_train" and test_file.is_file():
        test_sources = _sources(test_file, _parse(test_file))
        test_names = {source.name for source in test_sources}
        for source in sources:
            if source.name in test_names:
                raise DataError(test_file, f'"{source.name}" is in {file.name} too', "remove it from one of the two")
        sources += test_sources
    else:
        sources.sort(key=lambda source: source.image_path)
    require_unique_names(file, [source.name for source in sources])
    if train_names:
        if train_names.isdisjoint(source.name for source in sources):
            raise DataError(file, '"train_filenames" names none of its images', "correct it, or remove it")
        named = train_names | test_names
        sources = [source for source in sources if source.name in named]
    names = [source.name for source in sources]
    if test_names:
        train = [name for name in names if name not in test_names]
        test = [name for name in names if name in test_names]
        if not test:
            raise DataError(file, f'"{test_key}" names none of its images', "correct it, or remove it")
    else:
        train, test = every_eighth(names)
    return sources, train, test


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


def not_read(path: Path) -> list[str]:
    """What the frames of a data set say and no reader follows, in lines; nothing of other data sets. Raises
    ``DataError``."""
    given = path if path.suffix == ".json" and path.is_file() else None
    file = find_transforms(path) if path.is_dir() and not find_model(path) else given
    if not file:
        return []
    lines, frames = [], [frame for frame in _parse(file)["frames"] if isinstance(frame, dict)]
    if masks := [str(frame[MASK]) for frame in frames if frame.get(MASK)]:
        folder = (file.parent / masks[0].replace("\\", "/")).parent
        lines.append(f'the "{MASK}" of {len(masks)} of its frames, which --masks {folder} would follow')
    images = (_image_path(file.parent, str(frame.get("file_path", ""))) for frame in frames)
    if n := sum(is_file(image.with_name(f"{REPELLING}{image.stem}.png")) for image in images if image.name):
        like = "a folder with their negatives, named as the images"
        lines.append(f"the {REPELLING}*.png of {n} of its images, white where nothing counts: --masks takes {like}")
    return lines


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
        if not isinstance(frame, dict) or not {"file_path", "transform_matrix"} <= frame.keys():
            raise DataError(
                file, f'frame {i} lacks "file_path" or "transform_matrix"', "add both to each frame"
            )
    paths = [_image_path(file.parent, str(frame["file_path"])) for frame in frames]
    require_files(paths)
    sources = []
    for frame, image_path in zip(frames, paths, strict=True):
        name = str(frame["file_path"])
        try:
            said = merged(shared, frame)
            camera, lens = camera_of(file, said, image_path), lens_of(file, said)
        except (ValueError, TypeError, ArithmeticError) as error:
            if isinstance(error, DataError):
                raise
            raise DataError(file, f'frame "{name}": {error}', f"correct it ({CONVENTION})") from error
        sources.append(ViewSource(view_name(str(frame.get(NAME, name))), image_path, camera, lens))
    return sources


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
        raise DataError(file, f'"{key}" is no list', "make it a list of image names, or remove it")
    called = {view_name(str(f["file_path"])): s.name for f, s in zip(content["frames"], sources, strict=True)}
    places = {source.image_path.resolve(): source.name for source in sources} if named else {}
    found: set[str] = set()
    for name in map(str, named):
        path = _image_path(file.parent, name)
        place = places.get(path.resolve()) if is_file(path) else None
        found.add(called.get(view_name(name)) or place or view_name(name))
    return found


def _points(
    file: Path, content: dict[str, Any], sources: list[ViewSource], photographs: list[Path]
) -> tuple[np.ndarray, np.ndarray]:
    """Points [P, 3] and colours [P, 3] in the frame of the poses; see the module docstring for where from.

    ``photographs``: images that are there, in whose colours those of COLMAP's points are.
    """
    if content.get("ply_file_path"):
        return read_point_ply(file.parent / str(content["ply_file_path"]).replace("\\", "/"))
    model = find_model(file.parent)
    if model is None:
        return no_points()
    position_of = read_positions(model)
    pairs = [(s.camera.position, position_of[s.name]) for s in sources if s.name in position_of]
    if not pairs:
        return no_points()
    ours, theirs = np.array(pairs).transpose(1, 0, 2)  # [V, 3] each
    spread = np.linalg.norm(ours - ours.mean(axis=0), axis=1).max()
    if np.abs(ours - theirs).max() > 1e-3 * spread:
        return no_points()
    points = read_model_points(model)
    return points.positions, in_srgb(points.colors, photographs)
