"""Photographs as structure from motion takes them: upright, readable, each with its camera; and their masks."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from ..datasets.color_profiles import Encoding, as_srgb, in_rgb, space_of
from ..datasets.dataset import require_unique_names, view_name
from ..datasets.heif import FORMAT as HEIF
from ..datasets.images import UNREADABLE, open_image, read_image, stored, stored_size
from ..datasets.masks import mask_files, no_mask, require_white
from ..datasets.named_like_images import composed, require_same_way
from ..support.cores import usable_cores
from ..support.errors import DataError
from ..support.files import replacing
from .exif import QUARTER_TURNS, read_exif

AS_THEY_ARE = {"JPEG": "RGB L", "PNG": "RGB L RGBA"}  # modes that every tool reads; the file is copied
KINDS = {"MPO": "JPEG"}  # a JPEG with a preview behind the picture, as drones and phones write it
LOSSY = ("JPEG", HEIF)  # become JPEG where they are not copied: a PNG of them would be several times as large
SUFFIXES = {"JPEG": ".jpg", "PNG": ".png"}
QUALITY = {"quality": 95, "subsampling": 0}  # of JPEG where files are not copied


@dataclass(frozen=True)
class Photograph:
    """``name`` in the folder of images. Photographs with one ``camera`` share focal length and lens.

    ``focal`` in pixels, None if the file does not say; ``turn`` made the pixels of the file upright, None if they were;
    ``down`` as in ``Exif``.
    """

    name: str
    width: int
    height: int
    camera: str
    focal: float | None
    turn: Image.Transpose | None = None
    down: tuple[float, ...] | None = None


def prepare(sources: Mapping[str, Path], folder: Path, progress: Callable[[int, int], None]) -> list[Photograph]:
    """Write each image into ``folder``, turned as its EXIF says, unless it is there; in the order of the names.

    Files are copied as they are, but what has to be turned, or is no plain JPEG or PNG: HEIF becomes JPEG. White space
    in their names becomes ``_``, as COLMAP's text files have it between names, and so do a ``#`` that begins a name, as
    it begins comments there, and bytes that are no UTF-8. Raises ``DataError`` for a file that cannot be decoded.
    """
    require_own_names(sources, folder)
    made: list[Photograph] = []
    with ThreadPoolExecutor(min(8, usable_cores())) as pool:  # Pillow decodes without holding the GIL
        for photograph in pool.map(lambda item: _prepared(item[0], item[1], folder), sources.items()):
            made.append(photograph)
            progress(len(made), len(sources))
    return made


def _prepared(name: str, source: Path, folder: Path) -> Photograph:
    with readable(source) as image:
        exif, kind = read_exif(image), KINDS.get(image.format or "", image.format or "")
        copied = exif.turn is None and image.mode in AS_THEY_ARE.get(kind, "").split()
        made = "JPEG" if kind in LOSSY and "A" not in image.getbands() else "PNG"
        target = folder / solid_name(name)
        if kind != "JPEG" and not (copied and target.suffix.lower() == SUFFIXES[made]):  # what follows goes by the name
            target = target.with_suffix(SUFFIXES[made])
        missing, space = not target.is_file(), space_of(image)
        width, height = stored_size(image)[:: -1 if exif.turn in QUARTER_TURNS else 1]
        pixels = stored(image) if missing else None  # all of them: what is cut off shows now
        upright = _upright(pixels, source, exif.turn, space) if pixels and not copied else None
    if upright:
        _write(upright, target, made)
    elif missing:
        with replacing(target) as part:
            shutil.copyfile(source, part)
    camera, written = camera_of(exif.device, (width, height)), target.relative_to(folder).as_posix()
    return Photograph(written, width, height, camera, exif.focal, exif.turn, exif.down)


def require_own_names(sources: Mapping[str, Path], folder: Path) -> None:
    """Raise ``DataError`` where two images, as a JPEG and a TIFF of one name, would be one view of the data set in
    ``folder``, and for what ``require_unique_names`` does."""
    paths: dict[str, Path] = {}
    for name, path in sources.items():
        view = view_name(solid_name(name))
        if view in paths:
            problem = f'two views have the name "{view}", of this image and of {paths[view].name}'
            raise DataError(path, problem, "keep one of them, or rename it")
        paths[view] = path
    require_unique_names(folder, list(paths))


def camera_of(device: str, size: tuple[int, int]) -> str:
    """What photographs of one camera share: its device, and width and height of its images."""
    return "{} {}x{}".format(device, *size).strip()


def _lies(photograph: Photograph, mask: Path) -> bool:
    """Whether a mask was painted on the pixels of the file, which a quarter turn made upright."""
    with readable(mask) as image:
        return (image.width > image.height) != (photograph.width > photograph.height)


@contextmanager
def readable(source: Path) -> Iterator[Image.Image]:
    """The image of a file. What is raised of reading it becomes a ``DataError``."""
    try:
        with open_image(source) as image:
            yield image
    except UNREADABLE as error:
        if isinstance(error, DataError):
            raise
        raise DataError(source, f"cannot be read as an image ({error})", "replace the file or remove it") from error


def solid_name(name: str) -> str:
    """The name of an image as every tool takes it, see ``prepare``."""
    return re.sub(r"^#|[\s\ud800-\udfff]", "_", name)  # bytes of a name that are no UTF-8 are halves of characters


def _upright(
    image: Image.Image, source: Path, turn: Image.Transpose | None, space: bytes | Encoding | None
) -> Image.Image:
    """In RGB or RGBA. Colours become sRGB that the new file could not say, which has the profile of the old one."""
    if image.mode[0] in "IF":  # 16-bit grey; floating-point pixels are refused there, which Pillow would make black
        image = Image.fromarray(np.rint(read_image(source) * 255).astype(np.uint8))
    upright = image if turn is None else image.transpose(turn)
    alpha = "A" in upright.getbands() or "transparency" in upright.info
    made = in_rgb(upright, space, "RGBA" if alpha else "RGB")
    if isinstance(space, Encoding):
        return as_srgb(made, space)
    if upright.mode not in ("RGB", "RGBA", "P"):
        made.info.pop("icc_profile", None)  # of other channels than the file is to have
    return made


def _write(image: Image.Image, target: Path, kind: str) -> None:
    with replacing(target) as part:
        if kind == "JPEG":
            image.save(part, "JPEG", **QUALITY, icc_profile=image.info.get("icc_profile"))
        else:
            image.save(part, "PNG")


def masks_of(source: Path, names: Sequence[str]) -> dict[str, Path]:
    """The masks in a folder by the names, ``solid_name``, of their images. Raises ``DataError`` if there is none."""
    paths = {solid_name(name): path for name, path in mask_files(source).items()}
    found = {name: path for name in names if (path := paths.get(composed(view_name(name))))}
    if not found:
        raise no_mask(source, view_name(names[0]))
    return found


def prepare_masks(source: Path, photographs: list[Photograph], folder: Path) -> int:
    """Write ``<image>.png`` into ``folder`` for each photograph that has a mask, in its size; returns how many.

    A mask lies as its photograph is seen, or as the pixels of that lie in the file. Where one that a quarter turn made
    upright shows the latter by its shape, it holds for all: half a turn leaves the shape as it is. These names are
    COLMAP's and ``Masks``' own. Raises ``DataError`` if there is a mask for none, or one is unreadable.
    """
    masks = masks_of(source, [photograph.name for photograph in photographs])
    masked = [(photograph, masks[photograph.name]) for photograph in photographs if photograph.name in masks]
    all_lie = any(_lies(photograph, path) for photograph, path in masked if photograph.turn in QUARTER_TURNS)
    for photograph, path in masked:
        target = folder / f"{photograph.name}.png"
        if target.is_file():
            continue
        levels = read_image(path)[..., :3].mean(axis=2)  # as the training reads it: what is transparent is black
        require_white(path, float(levels.max()))
        grey = Image.fromarray(np.rint(255 * levels).astype(np.uint8))
        lies = _lies(photograph, path) if photograph.turn in QUARTER_TURNS else all_lie
        if lies and photograph.turn is not None:
            grey = grey.transpose(photograph.turn)
        require_same_way(path, grey.size, (photograph.width, photograph.height))
        grey = grey.resize((photograph.width, photograph.height))
        used = np.asarray(grey) >= 128
        _write(Image.fromarray(np.where(used, 255, 0).astype(np.uint8)), target, "PNG")
    return len(masked)
