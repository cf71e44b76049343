"""Colours of an image file as sRGB, where the file says that they are others.

Phones photograph in Display P3, some cameras in Adobe RGB. The same numbers taken as sRGB are paler than the scene was.
A file says so by the chunk cICP of a PNG, which comes before all else there, by an ICC profile, by numbers of HEIF that
are those of cICP, or, of Adobe RGB, by EXIF alone (JEITA CP-3461, DCF 2.0).
"""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from PIL import ExifTags, Image, ImageCms
from PIL.PngImagePlugin import PngImageFile

from ..support.srgb import srgb_to_linear
from .heif import code_of
from .primaries import ADOBE_RGB, WIDE, Primaries, srgb_levels

CHANNELS = slice(16, 20)  # of the header of a profile, by ICC.1
GREY_MODES = ("L", "LA")  # of Pillow, with 8 bits
LEVELS = 6  # of each channel, in the colours by which a profile is compared with sRGB
EQUAL = 1  # of 255: so much profiles of sRGB differ by their own rounding
UNCALIBRATED, ADOBE = 65535, "R03"  # ColorSpace and InteroperabilityIndex of EXIF, of Adobe RGB
ADOBE_GAMMA = 563 / 256
ROWS = 64  # of an image that are converted at once, in some 40 bytes a channel
SIGNATURE = 8  # bytes of a PNG before its chunks
LIKE_SRGB = (1, 2)  # primaries of ISO/IEC 23091-2: those of sRGB, or not said
CURVES = (1, 2, 6, 13, 14, 15)  # transfer functions, in the same table, that screens show by the curve of sRGB


@dataclass(frozen=True)
class Encoding:
    """Colours that a file names without a profile. ``gamma`` is None for the curve of sRGB."""

    primaries: Primaries
    gamma: float | None = None


def space_of(image: Image.Image) -> bytes | Encoding | None:
    """The colours of an image whose pixels are not read yet: its ICC profile, what it says else, or None for nothing.

    Raises ``ValueError`` for colours that a PNG or HEIF names and that are not read, such as HDR.
    """
    code = _coded(image) if isinstance(image, PngImageFile) else None
    if code is not None:
        primaries, curve, matrix, full = code
        return _named(primaries, curve, f"{primaries}/{curve}/{matrix}/{full} by cICP", not matrix and full == 1)
    if profile := image.info.get("icc_profile"):
        return profile
    numbers = code_of(image)
    if numbers is not None:
        return _named(*numbers, "{}/{} by nclx".format(*numbers))
    return Encoding(ADOBE_RGB, ADOBE_GAMMA) if _is_adobe_rgb(image) else None


def _named(primaries: int, curve: int, said: str, is_rgb: bool = True) -> Encoding | None:
    """Colours by their numbers in ISO/IEC 23091-2; ``said`` is how a file writes them."""
    if not is_rgb or curve not in CURVES or primaries not in (*LIKE_SRGB, *WIDE):
        raise ValueError(f"its colours, {said}, are not read; save it as sRGB")
    return Encoding(WIDE[primaries]) if primaries in WIDE else None


def in_rgb(image: Image.Image, space: bytes | Encoding | None, mode: str) -> Image.Image:
    """The pixels of an image as ``mode``, RGB or RGBA, in the colours that they have. Grey and CMYK become sRGB.

    Raises ``ValueError`` for CMYK without a profile of it.
    """
    if image.mode in GREY_MODES and (curve := grey_curve(space)) is not None:
        pixels = np.array(image.convert(mode))
        pixels[..., :3] = np.rint(255 * curve).astype(np.uint8)[pixels[..., :3]]
        return Image.fromarray(pixels)
    if image.mode != "CMYK":
        return image.convert(mode)
    transform = _to_srgb(space, "CMYK", mode) if isinstance(space, bytes) else None
    converted = ImageCms.applyTransform(image, transform) if transform else None
    if converted is None:
        raise ValueError("its CMYK has no profile that says which colours they are; save it as RGB")
    return converted


def grey_curve(space: bytes | Encoding | None) -> np.ndarray | None:
    """[256] float32, the sRGB values of grey levels 0 to 255 of a ``space``; None where they are that already, or it is
    no profile of grey."""
    return _grey_curve(space) if isinstance(space, bytes) and space[CHANNELS] == b"GRAY" else None


def as_srgb(image: Image.Image, space: bytes | Encoding | None) -> Image.Image:
    """An image of mode RGB or RGBA, with the colours of ``space``, in sRGB, clipped to what that can hold.

    The same image without a space, with one of sRGB, of other channels than RGB, or a profile that cannot be used.
    Grey and CMYK became sRGB before (``in_rgb``).
    """
    if isinstance(space, Encoding):
        pixels = np.array(image)
        levels = np.arange(256, dtype=np.float32) / 255
        gamma = space.gamma
        light = srgb_to_linear(levels) if gamma is None else np.power(levels, gamma, dtype=np.float32)
        for top in range(0, len(pixels), ROWS):
            colors = pixels[top : top + ROWS, :, :3]
            colors[...] = srgb_levels(light[colors], space.primaries)
        return Image.fromarray(pixels)
    transform = _to_srgb(space, image.mode, image.mode) if space else None
    return image if transform is None else ImageCms.applyTransform(image, transform) or image


def _coded(image: PngImageFile) -> tuple[int, ...] | None:
    """The four numbers of the chunk cICP of a PNG, or None; Pillow does not read it."""
    file = image.fp
    if file is None:
        return None
    before = file.tell()
    file.seek(SIGNATURE)
    found = None
    while len(head := file.read(8)) == 8 and head[4:] not in (b"IDAT", b"IEND"):
        size = struct.unpack(">I", head[:4])[0]
        if head[4:] == b"cICP" and size == 4:
            found = tuple(file.read(4))
            break
        file.seek(size + 4, io.SEEK_CUR)  # and the checksum
    file.seek(before)
    return found


def _is_adobe_rgb(image: Image.Image) -> bool:
    try:
        tags = image.getexif()
        space = tags.get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.ColorSpace)
        index = tags.get_ifd(ExifTags.IFD.Interop).get(ExifTags.Interop.InteropIndex)
    except (OSError, ValueError, SyntaxError, TypeError, KeyError):
        return False
    return space == UNCALIBRATED and str(index).strip("\0 ") == ADOBE


@lru_cache(16)
def _to_srgb(profile: bytes, source_mode: str, mode: str) -> ImageCms.ImageCmsTransform | None:
    """What converts pixels of a mode; None where it would change nothing, or cannot be had."""
    if profile[CHANNELS] != (b"CMYK" if source_mode == "CMYK" else b"RGB "):
        return None
    try:
        transform = _transform(profile, source_mode, mode)
        if source_mode != mode:
            return transform
        colors = _grid().convert(mode)
        changed = np.asarray(ImageCms.applyTransform(colors, transform), np.int16) - np.asarray(colors, np.int16)
    except (ImageCms.PyCMSError, OSError):
        return None
    return transform if abs(changed).max() > EQUAL else None


@lru_cache(16)
def _grey_curve(profile: bytes) -> np.ndarray | None:
    levels = np.arange(256, dtype=np.uint8)
    try:
        seen = ImageCms.applyTransform(Image.fromarray(levels[None]), _transform(profile, "L", "RGB"))
    except (ImageCms.PyCMSError, OSError):
        return None
    curve = np.asarray(seen, np.float32)[0].mean(axis=1)  # as grey as 8 bits can be
    return curve / 255 if abs(curve - levels).max() > EQUAL else None


def _transform(profile: bytes, source_mode: str, mode: str) -> ImageCms.ImageCmsTransform:
    """From pixels of a profile to sRGB. Raises ``ImageCms.PyCMSError`` or ``OSError`` where it cannot be had."""
    source, srgb = ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
    intent, flags = ImageCms.Intent.RELATIVE_COLORIMETRIC, ImageCms.Flags.BLACKPOINTCOMPENSATION
    return ImageCms.buildTransform(source, srgb, source_mode, mode, intent, flags)


def _grid() -> Image.Image:
    steps = np.linspace(0, 255, LEVELS).round().astype(np.uint8)
    return Image.fromarray(np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(LEVELS, -1, 3))
