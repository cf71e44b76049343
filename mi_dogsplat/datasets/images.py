"""Image files: their pixels, premultiplied, as ``float32``, and what their headers say.

- **EXIF orientation is ignored.** Structure from motion calibrates the stored pixel grid, so turning the
  image would break its camera. Pillow turns TIFFs by itself: that is undone.
- **OpenEXR** holds linear radiance (``exr.py``).
- **HEIF** of phones and cameras comes upright (``heif.py``).
- **Colours become sRGB** where the file says that they are others (``color_profiles.py``).
- 16-bit grey PNG keeps its depth; 16-bit colour PNG is read with 8 bits, which is what Pillow offers.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import Literal
from unicodedata import normalize

import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.TiffImagePlugin import IMAGELENGTH, IMAGEWIDTH, TiffImageFile

from ..support.errors import DataError
from .claimed_size import require_photograph
from .color_profiles import Encoding, as_srgb, grey_curve, in_rgb, space_of
from .exr import exr_header, exr_saturation, is_exr, read_exr
from .heif import is_heif, opened

EXIF_ORIENTATION = 274
TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}  # by the value of the tag: what makes the pixels upright; 1 is upright
BACK = {
    Image.Transpose.ROTATE_90: Image.Transpose.ROTATE_270,
    Image.Transpose.ROTATE_270: Image.Transpose.ROTATE_90,
}  # what undoes a turn; each of the others undoes itself
FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "PPM", "GIF")  # others start programs, or trust the file's name
AVIF = b"ftypavif"  # bytes 4 to 12, by ISO/IEC 14496-12
FORMS: tuple[Literal["NFC", "NFD"], ...] = ("NFC", "NFD")  # of Unicode: letters with their marks, or both apart
Image.init()  # makes all formats known: by itself Pillow does so when the first few have failed
UNREADABLE = (
    OSError,
    SyntaxError,
    ValueError,
    Image.DecompressionBombError,
    EOFError,
    RuntimeError,
)  # what Pillow raises for bad files, and libheif, which has the last two


def is_file(path: Path) -> bool:
    """``path.is_file()``, and False for what can be no file: a name of 300 characters, or one in a loop of links."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def named_file(folder: Path, name: str | PurePath) -> Path:
    """The file of a folder that a data set names; where there is none so spelt, one that other systems call the same.

    Windows and macOS tell no case of an extension, and macOS takes "ü" apart into "u" and two dots.
    """
    if is_file(folder / name):
        return folder / name
    pure = PurePath(name)
    cases = [pure, *(pure.with_suffix(suffix) for suffix in (pure.suffix.lower(), pure.suffix.upper()) if suffix)]
    spelt = (folder / normalize(form, str(case)) for case in cases for form in FORMS)
    return next((path for path in spelt if is_file(path)), folder / name)


@contextmanager
def open_image(path: Path) -> Iterator[Image.Image]:
    """An image whose pixels are not read yet. Raises one of ``UNREADABLE``, also for a decompression bomb."""
    # not by its name: Pillow would map the file to memory, with width and height of a turned TIFF exchanged
    with path.open("rb") as file:
        try:
            image = Image.open(file, formats=FORMATS)
        except UnidentifiedImageError:
            file.seek(0)
            head = file.read(16)
            file.seek(0)
            if not is_heif(head):
                raise ValueError(_unidentified(head)) from None
            image = opened(file)
        with image:
            require_photograph(image.width, image.height, path.stat().st_size)
            yield image


def _unidentified(head: bytes) -> str:
    """What a file of none of the ``FORMATS`` is, by its first 16 bytes."""
    if not head:
        return "it is empty"
    if head[4:12] == AVIF:
        return "it is AVIF: export it as JPEG or PNG"
    return f"it is no {', '.join(FORMATS)} or HEIF"


def stored(image: Image.Image) -> Image.Image:
    """The image with its pixels read, as they lie in the file. Raises one of ``UNREADABLE``."""
    turn = TURNS.get(image.tag_v2.get(EXIF_ORIENTATION, 1)) if isinstance(image, TiffImageFile) else None
    image.load()  # which removes the tag where Pillow is new
    return image if turn is None else image.transpose(BACK.get(turn, turn))


def stored_size(image: Image.Image) -> tuple[int, int]:
    """(width, height) of the pixels as they lie in the file of an image that was opened, whether they are read or not.

    Some versions of Pillow exchange those of a TIFF before they turn it, others only then.
    """
    if isinstance(image, TiffImageFile):
        return image.tag_v2[IMAGEWIDTH], image.tag_v2[IMAGELENGTH]
    return image.size


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) of an image from its header alone. Raises ``DataError``."""
    return header(path)[0]


def box_downscale(image: np.ndarray, k: int) -> np.ndarray:
    """Mean over k x k blocks: [H, W, C] -> float32 [H // k, W // k, C]."""
    height, width = image.shape[0] // k, image.shape[1] // k
    blocks = image[: height * k, : width * k].reshape(height, k, width, k, -1)  # [H/k, k, W/k, k, C]
    return blocks.mean(axis=(1, 3), dtype=np.float32)


def read_image(path: Path) -> np.ndarray:
    """Display values of an image file, or linear radiance of OpenEXR: float32 [H, W, 3], or [H, W, 4] premultiplied.

    Raises ``DataError``.
    """
    if is_exr(path):
        return read_exr(path)
    try:
        with open_image(path) as opened:
            space = space_of(opened)
            image = stored(opened)
            if image.mode == "F":
                raise ValueError("floating-point pixels have no display range")
            if image.mode.startswith("I"):  # 16-bit grey, as which Pillow may give 32 bits, too
                levels = np.asarray(image)  # [H, W]
                if levels.min() < 0 or levels.max() > 65535:
                    raise ValueError("whole numbers beyond 16 bits have no display range")
                values, curve = levels.astype(np.float32) / 65535, grey_curve(space)
                if curve is not None:
                    values = np.interp(values, np.linspace(0, 1, len(curve)), curve).astype(np.float32)
                grey = np.repeat(values[..., None], 3, axis=2)
                shown = _shown(image, levels)
                return grey if shown is None else np.concatenate([grey * shown, shown], axis=2)
            alpha = "A" in image.getbands() or "transparency" in image.info
            colors = as_srgb(in_rgb(image, space, "RGBA" if alpha else "RGB"), space)
            pixels = np.asarray(colors, dtype=np.float32) / 255  # [H, W, 3 or 4]
    except UNREADABLE as error:
        raise _corrupt(path, error) from error
    if pixels.shape[2] == 4:
        pixels[..., :3] *= pixels[..., 3:]
    return pixels


def _shown(image: Image.Image, levels: np.ndarray) -> np.ndarray | None:
    """Alpha [H, W, 1] of 16-bit grey ``levels`` [H, W], 0 where they are the one that a PNG may name as transparent;
    None where it names none. Pillow turns whole numbers into RGBA by cutting off what is above 255."""
    level = image.info.get("transparency")
    return None if level is None else (levels != level).astype(np.float32)[..., None]


def saturation(path: Path) -> float | None:
    """The value of a channel from which on the sensor was full, where an OpenEXR file names it; else None. Renders are
    clamped to the range of display values anyway. Raises ``DataError``."""
    return exr_saturation(path) if is_exr(path) else None


def straight_color(color: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """[H, W, 3] of ``color`` that is premultiplied with ``alpha`` [H, W, 1]; 0 where that is 0."""
    return np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)


def header(path: Path) -> tuple[tuple[int, int], bool]:
    """((width, height), whether there is an alpha channel) of an image from its header alone. Raises ``DataError``."""
    if is_exr(path):
        return exr_header(path)
    try:
        with open_image(path) as image:
            return stored_size(image), "A" in image.getbands() or "transparency" in image.info
    except UNREADABLE as error:
        raise _corrupt(path, error) from error


def color_space(path: Path) -> bytes | Encoding | None:
    """``space_of`` an image file; None of OpenEXR. Raises ``DataError``."""
    if is_exr(path):
        return None
    try:
        with open_image(path) as image:
            return space_of(image)
    except UNREADABLE as error:
        raise _corrupt(path, error) from error


def is_opaque(path: Path) -> bool:
    """Whether an image with an alpha channel does without it. Raises ``DataError``."""
    if is_exr(path):
        return bool((read_exr(path)[..., 3] == 1).all())
    try:
        with open_image(path) as image:
            if image.mode.startswith("I"):
                shown = _shown(image, np.asarray(image))
                return shown is None or bool(shown.all())
            return image.convert("RGBA").getchannel("A").getextrema() == (255, 255)
    except UNREADABLE as error:
        raise _corrupt(path, error) from error


def is_turned(path: Path) -> bool:
    """Whether the tag of an image asks to show it turned. Raises one of ``UNREADABLE``."""
    if is_exr(path):
        return False
    with open_image(path) as image:
        return image.getexif().get(EXIF_ORIENTATION, 1) != 1


def _corrupt(path: Path, error: Exception) -> DataError:
    return DataError(path, f"cannot be read as an image ({error})", "replace the file or remove its entry")
