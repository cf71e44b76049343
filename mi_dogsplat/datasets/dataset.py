"""What every reader returns: views with their images, sparse points, and the train/test split."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..scene.cameras import Camera, spread_of
from ..support.errors import DataError
from ..support.files import encoded_name

if TYPE_CHECKING:
    from .lens import Undistortion

TEST_EVERY = 8  # as in LLFF and 3DGS: images 0, 8, 16, ... by sorted name are held out
SPLITS = ("test", "validation")
# of names of pictures that are written beside NAME.png of a view (evaluate.py, mixture.py, misfits.py)
PICTURE_ENDS = ("_gt", "_error", "_mask", "_gaussian", "_dog", "_plain", "_plain_error")
MAX_FILE_NAME = 255  # bytes, on the usual file systems
IMAGES = r"images(_\d+)?"  # folders of a data set's images, and of smaller copies

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Recording:
    """What a photograph holds: its ``image``, as ``View`` has it, and where that is only a bound.

    ``saturated``: [H, W] bool, true where the sensor was full, so that the scene is at least as bright as the image;
    None where it was full nowhere, or nobody knows.
    """

    image: np.ndarray
    saturated: np.ndarray | None = None

    @property
    def n_bytes(self) -> int:
        """What it takes of memory."""
        return self.image.nbytes + (0 if self.saturated is None else self.saturated.nbytes)


@dataclass(frozen=True, eq=False)
class View:
    """One image and its camera.

    ``name`` is unique within its data set and usable as a file name. ``stored``: the ``image`` itself, or its
    ``pixels``, or the ``recording``, or a function that reads that from disk. ``straight``: how the lens of the
    photograph was taken out of it; None where it had none. ``white``: None where the image is display-referred; of
    linear radiance the one that a screen shows as white, which exposes the image.
    """

    name: str
    camera: Camera
    stored: np.ndarray | Recording | Callable[[], Recording]
    straight: Undistortion | None = None
    white: float | None = None

    @property
    def image(self) -> np.ndarray:
        """float32 [H, W, 3], or [H, W, 4] premultiplied: sRGB values in 0..1, or linear radiance.

        It is made, or read, whenever it is asked for unless it is stored itself. Raises ``DataError`` where it cannot
        be read.
        """
        return self.recording.image

    @property
    def recording(self) -> Recording:
        """The ``image``, and where it is saturated; made, or read, as the image is. Raises ``DataError`` likewise."""
        if isinstance(self.stored, Recording):
            return self.stored
        if isinstance(self.stored, np.ndarray):
            return Recording(self.stored if self.pixels is None else from_bytes(self.pixels))
        return self.stored()

    def in_memory(self) -> View:
        """The view with its recording, so that it is read once however often it is asked for. Raises ``DataError``."""
        return self if isinstance(self.stored, np.ndarray) else replace(self, stored=self.recording)

    @property
    def pixels(self) -> np.ndarray | None:
        """[H, W, 3] uint8 that ``from_bytes`` makes the image of, where these are stored: a quarter of the memory."""
        return self.stored if isinstance(self.stored, np.ndarray) and self.stored.dtype == np.uint8 else None

    @property
    def n_bytes(self) -> int:
        """What the image takes of memory."""
        if isinstance(self.stored, Recording):
            return self.stored.n_bytes
        return self.stored.nbytes if isinstance(self.stored, np.ndarray) else 0


def held(view: View) -> View:
    """The view, as bytes if its image has no more to it: of a file with 8 bits, opaque and neither straightened nor
    shrunk."""
    image = view.image
    pixels = as_bytes(image) if image.shape[2] == 3 else None
    return view if pixels is None else replace(view, stored=pixels)


def as_bytes(image: np.ndarray) -> np.ndarray | None:
    """uint8 from which ``from_bytes`` makes the very same image; None where there are none."""
    pixels = np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)
    return pixels if np.array_equal(from_bytes(pixels), image) else None


def from_bytes(pixels: np.ndarray) -> np.ndarray:
    """Display values, float32."""
    image = pixels.astype(np.float32)
    image /= 255  # in place: to ask for memory takes longer than to divide
    return image


@dataclass(frozen=True, eq=False)
class Observations:
    """Sparse points that one view is known to see: ``pixels`` [M, 2] in that view, ``points`` [M] rows of the
    set's."""

    pixels: np.ndarray
    points: np.ndarray


@dataclass(eq=False)
class Dataset:
    """Views, split, with ``points`` [P, 3] float32 (P may be 0), ``point_colors`` [P, 3] float32 in 0..1.

    ``test`` is what is measured: the test views, or with the split "validation" those that the data have for that, or
    else views held out of the training views.
    ``has_alpha``: every image has a fourth channel (else none has). ``observations`` maps view names to what
    the view sees; empty where the data do not say. ``rig_frames`` has a number for each moment of a rig, by the names
    of the views of that moment.
    """

    path: Path
    train: list[View]
    test: list[View]
    points: np.ndarray
    point_colors: np.ndarray
    has_alpha: bool
    observations: dict[str, Observations] = field(default_factory=dict)
    rig_frames: dict[str, int] = field(default_factory=dict)

    @property
    def views(self) -> list[View]:
        """All views, train first."""
        return self.train + self.test

    @property
    def white(self) -> float | None:
        """That of all views; None where they are display-referred."""
        return self.train[0].white

    def exposed(self, white: float) -> Dataset:
        """The same images of linear radiance, shown with another ``white``."""
        train, test = ([replace(view, white=white) for view in views] for views in (self.train, self.test))
        return replace(self, train=train, test=test)


def no_points() -> tuple[np.ndarray, np.ndarray]:
    """Points and colours of a data set that has none: float32 [0, 3] twice."""
    return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)


def every_eighth(items: Sequence[T], rig_frames: Mapping[T, int] | None = None) -> tuple[list[T], list[T]]:
    """Split into (train, test): items 0, 8, 16, ... are test. A single item is train, since training needs
    one.

    Items of one rig frame, such as the sides of a panorama, are split as one item, where the first of them is: else
    a test view would have views beside it that were taken from the same place.
    """
    frames = rig_frames or {}
    numbers: dict[tuple[bool, T | int], int] = {}
    keys = [(item in frames, frames.get(item, item)) for item in items]
    counted = [(item, numbers.setdefault(key, len(numbers))) for item, key in zip(items, keys, strict=True)]
    if len(numbers) < 2:
        return list(items), []
    train = [item for item, number in counted if number % TEST_EVERY]
    return train, [item for item, number in counted if number % TEST_EVERY == 0]


def held_out(
    train: Sequence[T],
    test: Sequence[T],
    split: str,
    validation: Sequence[T] = (),
    rig_frames: Mapping[T, int] | None = None,
) -> tuple[list[T], list[T]]:
    """(what is trained on, what is measured) by a split in ``SPLITS``, of views that are not read yet.

    With "validation" the views ``validation`` of the data are measured in place of the test views, or every 8th
    training view where it has none (``rig_frames``: see ``every_eighth``). Nobody reads the test views then, so that no
    choice depends on them.
    """
    if split == "test":
        return list(train), list(test)
    kept = set(validation)
    return ([view for view in train if view not in kept], list(validation)) if kept else every_eighth(train, rig_frames)


def views_named(views: Sequence[View], names: Sequence[str]) -> list[View]:
    """Those of the views that have one of the names, in their order."""
    wanted = set(names)
    return [view for view in views if view.name in wanted]


def view_name(file: str) -> str:
    """View name of an image file as the data set spells it: no extension, no folder ``images`` or ``images_2``, ``/``
    becomes ``_``. What follows the last dot is an extension if it begins with a letter: ``r_0.5`` has none."""
    path = Path(file.replace("\\", "/"))
    path = path.with_suffix("") if path.suffix[1:2].isalpha() else path
    parts = [part for part in path.parts if part not in (".", "..", "/")]
    if len(parts) > 1 and re.fullmatch(IMAGES, parts[0]):
        parts = parts[1:]
    return "_".join(parts)


def view_meant(told: str, names: Container[str], folder: Path | None = None) -> str | None:
    """The one of the view ``names`` that somebody tells by itself, or by its image file: with or without its ending,
    as it was named before structure from motion took it over, or by its path, where that leads into ``folder``."""
    plain = view_name(told)
    spelt = [told, plain, re.sub(r"^#|\s", "_", plain)]
    if folder is not None and (path := Path(os.path.abspath(told))).is_relative_to(top := os.path.abspath(folder)):
        spelt.append(view_name(str(path.relative_to(top))))
    return next((name for name in spelt if name in names), None)


def counted_order(name: str) -> tuple[list[str | int], str]:
    """A key that sorts names as one counts: 9 before 10."""
    parts = re.split(r"([0-9]+)", name)  # every other one is a number
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], name


def require_unique_names(path: Path, names: Sequence[str]) -> None:
    """Raise ``DataError`` where two views would share a name or an output file: "a" and "a_gt" both write a_gt.png; and
    where the name of such a file would be longer than ``MAX_FILE_NAME``, or none in the locale of the system."""
    seen: set[str] = set()
    most = MAX_FILE_NAME - max(len(f"{end}.png") for end in PICTURE_ENDS)
    for name in names:
        if (size := len(encoded_name(name, path))) > most:
            problem = f'the view "{name[:40]}…" has a name of {size} bytes, too long for those of its pictures'
            raise DataError(path, problem, f"shorten the name of the image, or of its folders, to {most}")
        if name in seen:
            raise DataError(path, f'two views have the name "{name}"', "give each image its own name")
        seen.add(name)
    for name in names:
        for end in PICTURE_ENDS:
            if (other := name.removesuffix(end)) != name and other in seen:
                problem = f'of the views "{other}" and "{name}" pictures would have the same name, {name}.png'
                raise DataError(path, problem, "rename one of the images")


def camera_extent(views: Sequence[View]) -> float:
    """Scene extent in world units: 1.1 x the largest distance of a camera from the mean camera (3DGS).

    Cameras that are all at one place say nothing about the scale; they get 1.
    """
    return 1.1 * spread_of([view.camera for view in views]) or 1.0
